"""How long work tells about its progress."""

from typing import Protocol


class Report(Protocol):
    """Is told about progress."""

    def __call__(self, stage: str, done: int, total: int, detail: str = "", /) -> None:
        """Hears a stage's name, how much of it is done, how much there is, and what it comes to so far."""


def silent(_stage: str, _done: int, _total: int, _detail: str = "", /) -> None:
    """Tell nobody."""
