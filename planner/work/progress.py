"""Reports of progress."""

from typing import Protocol


class Report(Protocol):
    """Callback that receives the progress of some work."""

    def __call__(self, stage: str, done: int, total: int, detail: str = "", /) -> None:
        """Receives the state of the work.

        Args:
            stage: name of the current stage.
            done: amount of the stage that is done, in any unit.
            total: total amount of the stage in this unit.
            detail: the result so far, as text for people.
        """


def silent(_stage: str, _done: int, _total: int, _detail: str = "", /) -> None:
    """Progress callback that does nothing."""
