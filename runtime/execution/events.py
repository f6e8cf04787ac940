"""What a run tells those who watch it: phases, squeezes, parts, their sum."""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from runtime.table import Pose2, takt_figures
from runtime.traversal.results import Outcome, PartResult, Step


class Phase(Enum):
    """What the cell is doing; the value is its name in the status."""

    IDLE = "idle"
    RESUME = "resume"  # freeing the hand after a run that broke off
    PUSH = "push"  # retreat, set the jaws, travel, descend, go on
    PLACE = "place"  # retreat, open, travel, descend
    SQUEEZE = "squeeze"  # close and settle
    READ = "read"  # decide and journal
    RELEASE = "release"  # open, retreat
    AUDIT = "audit"
    DELIVER = "deliver"
    SAFE = "safe"  # on the way to the declared safe state
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a simulated part really lies, and how far the prediction is off."""

    true: Pose2 | None  # mm, mm, rad; None in a rehearsal, whose part has no pose
    # by the goal's metric; None without a prediction, or where the goal has none
    error_mm: float | None
    within: bool | None  # whether the prediction meets the goal, None without one
    crashes: int  # times open fingers were placed onto this part
    hypothesis: str | None = None  # which part it really is, where the table leaves that open


@dataclass(slots=True)
class Tally:
    """The sum over a run's parts; its size does not grow with their number."""

    takt_s: float | None = None  # the time within which parts should be done
    # whether its seconds are the cell's; not those of a clock that runs faster than life
    timed: bool = True
    parts: int = 0
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    squeezes: int = 0
    exit_code: int = 0  # the highest of the parts' codes, which are numbered by gravity
    # parts whose leaf met the goal, None where no truth is known or they are gone
    within: int | None = None
    crashes: int | None = None  # times open fingers were placed onto a part, None on a real cell
    # of parts with an outcome, to hundredths
    seconds: Counter[float] = field(default_factory=Counter)

    def add(self, result: PartResult, seen: Sighting | None) -> None:
        """One more part."""
        self.parts += 1
        self.squeezes += len(result.steps)
        self.outcomes[result.outcome] += 1
        self.exit_code = max(self.exit_code, result.exit_code)
        if result.seconds:  # a clock that stands still times nothing
            self.seconds[round(result.seconds, 2)] += 1
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
                outcome.value: self.outcomes[outcome]
                for outcome in Outcome
                if self.outcomes[outcome]
            },
            **{name: round(value, 4) for name, value in self.times().items()},
        }

    def times(self) -> dict[str, float]:
        """What parts took, of `runtime.table.takt`; nothing before the first or of a clock faster than life.

        Where a simulated cell runs faster than life, programs that are no faster count as much longer.
        """
        return takt_figures(self.seconds, self.takt_s) if self.seconds and self.timed else {}


class Console:
    """Told what happens, in order; must not raise. Who derives from it need not listen to all of it."""

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        """A change of phase, and the node where there is one."""

    def note(self, sentence: str) -> None:
        """Something the reader should know."""

    def step(self, part: int, step: Step) -> None:
        """One squeeze."""

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """One part's end."""

    def summary(self, tally: Tally, journal: Path) -> None:
        """The run's end."""
