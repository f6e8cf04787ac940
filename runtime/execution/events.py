"""What a run tells those who watch it: phases, squeezes, parts, their sum; and the Protocols that hear it."""

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

from runtime.table import Pose2
from runtime.traversal.results import Outcome, PartResult, Step


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


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a simulated part really lies, and how far the prediction is off.

    Attributes:
        true: mm, mm, rad; None in a rehearsal, whose part has no pose.
        error_mm: distance by the goal's metric; None without a prediction, or where the goal has none.
        within: whether the prediction meets the goal, None without one.
        crashes: times open fingers were placed onto this part.
    """

    true: Pose2 | None
    error_mm: float | None
    within: bool | None
    crashes: int


class Tally:
    """The sum over a run's parts; its size does not grow with their number.

    Attributes:
        parts: their number.
        outcomes: parts by outcome.
        squeezes: over all parts.
        exit_code: the highest of the parts' codes, which are numbered by gravity; 0 if every part reached a
            leaf.
        within: parts whose leaf met the goal, None where no truth is known, or the parts were taken away.
        crashes: times open fingers were placed onto a part, None on a real cell.
    """

    def __init__(self) -> None:
        self.parts = self.squeezes = self.exit_code = 0
        self.outcomes: Counter[Outcome] = Counter()
        self.within: int | None = None
        self.crashes: int | None = None

    def add(self, result: PartResult, seen: Sighting | None) -> None:
        """One more part."""
        self.parts += 1
        self.squeezes += len(result.steps)
        self.outcomes[result.outcome] += 1
        self.exit_code = max(self.exit_code, result.exit_code)
        if seen is None:
            return
        self.crashes = (self.crashes or 0) + seen.crashes
        if seen.true is not None and result.delivery is None:
            self.within = (self.within or 0) + (seen.within is True)

    def fields(self) -> dict[str, object]:
        """The sum as a journal record holds it."""
        return {
            "parts": self.parts,
            "outcomes": {
                outcome.value: self.outcomes[outcome] for outcome in Outcome if self.outcomes[outcome]
            },
        }


class Console(Protocol):
    """Told what happens, in order."""

    def note(self, sentence: str) -> None:
        """Something the reader should know."""

    def step(self, part: int, step: Step) -> None:
        """One squeeze."""

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """One part's end."""

    def summary(self, tally: Tally, journal: Path) -> None:
        """The run's end."""
