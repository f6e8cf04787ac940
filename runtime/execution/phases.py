"""The states of the loop, as a status display and a watchdog see them go by."""

from enum import Enum
from typing import Protocol


class Phase(Enum):
    """What the cell is doing; the value is its name in the status."""

    IDLE = "idle"
    RESUME = "resume"  # freeing the hand after a run that broke off
    PLACE = "place"  # retreat, open, travel, descend
    SQUEEZE = "squeeze"  # close and settle
    READ = "read"  # decide and journal
    RELEASE = "release"  # open, retreat
    AUDIT = "audit"
    DELIVER = "deliver"
    SAFE = "safe"  # on the way to the declared safe state
    DONE = "done"


class Watcher(Protocol):
    """Told of each change of phase; must not raise."""

    def __call__(self, part: int, phase: Phase, node: int | None) -> None:
        """The cell is now in `phase` with `part`, at `node` where there is one."""


def ignore_phase(part: int, phase: Phase, node: int | None) -> None:
    """Do nothing: the watcher of a run that nobody watches."""
