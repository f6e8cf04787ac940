"""Reports of progress."""

from typing import Protocol


class Report(Protocol):
    """Callback for progress."""

    def __call__(self, stage: str, done: int, total: int, detail: str = "", /) -> None:
        """Receives the name of a stage, its done and its total amount, and the result so far as text."""


def silent(_stage: str, _done: int, _total: int, _detail: str = "", /) -> None:
    """No-op progress callback."""
