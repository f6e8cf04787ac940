"""How long work tells about its progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Report: TypeAlias = Callable[[str, int, int], None]
"""Called with a stage's name, how much of it is done and how much there is."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """Tell nobody."""
