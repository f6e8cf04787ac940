"""Reports of progress."""

from typing import Protocol


class Report(Protocol):
    """Callback for progress."""

    def __call__(self, stage: str, done: int, total: int, detail: str = "", /) -> None:
        """Receives a stage's name, how much of it is done, of how much, and the result so far."""


def silent(_stage: str, _done: int, _total: int, _detail: str = "", /) -> None:
    """No-op progress callback."""
