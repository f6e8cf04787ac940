"""Events of a run for observers: phases, squeezes and results of parts, and the totals of the run."""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from runtime.table import Pose2, takt_figures
from runtime.traversal.results import Outcome, PartResult, Step


class Phase(Enum):
    """What the cell is doing; the value is the name that the cell's status shows."""

    IDLE = "idle"
    RESUME = "resume"  # freeing the hand after a run that broke off
    PUSH = "push"  # retreat, set the jaws, travel, descend, push
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
    """True pose of a simulated part, and the error of the prediction."""

    true: Pose2 | None  # mm, mm, rad; None in a rehearsal, whose part has no pose
    # error of the prediction (eq. 9); None without a prediction, and for the goals orientation and identity
    error_mm: float | None
    within: bool | None  # whether the prediction meets the goal; None without a prediction
    crashes: int  # times open fingers were placed onto this part
    hypothesis: str | None = None  # name of the part that it truly is, for a table of several parts


@dataclass(slots=True)
class Tally:
    """Running totals over the parts of a run: outcomes, squeezes, times, parts within the goal, crashes."""

    takt_s: float | None = None  # the time within which parts should be done
    # whether the clock counts seconds of the cell; False for a clock faster than real time
    timed: bool = True
    parts: int = 0
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    squeezes: int = 0
    exit_code: int = 0  # the highest of the parts' codes, which increase with severity
    # parts whose leaf met the goal; None where the truth is unknown
    within: int | None = None
    crashes: int | None = None  # times open fingers were placed onto a part, None on a real cell
    # number of parts with an outcome, by their time to hundredths of a second
    seconds: Counter[float] = field(default_factory=Counter)

    def add(self, result: PartResult, seen: Sighting | None) -> None:
        """Adds a part's result and, in a simulated cell, the comparison with its true pose."""
        self.parts += 1
        self.squeezes += len(result.steps)
        self.outcomes[result.outcome] += 1
        self.exit_code = max(self.exit_code, result.exit_code)
        if result.seconds:  # a clock that does not advance times nothing
            self.seconds[round(result.seconds, 2)] += 1
        if seen is None:
            return
        self.crashes = (self.crashes or 0) + seen.crashes
        if seen.true is not None and result.delivery is None:
            self.within = (self.within or 0) + (seen.within is True)

    def fields(self) -> dict[str, object]:
        """Numbers of parts and outcomes, and the times' statistics, as fields of a journal record."""
        counts = {each.value: self.outcomes[each] for each in Outcome if self.outcomes[each]}
        times = {name: round(value, 4) for name, value in self.times().items()}
        return {"parts": self.parts, "outcomes": counts, **times}

    def times(self) -> dict[str, float]:
        """Statistics of the parts' times, by the names of `runtime.table.takt`; empty before the first part.

        The result is also empty if `timed` is False. Then the cell runs faster than real time. Each second of
        the machine's computing adds several seconds to a part's time, so that the time means nothing.
        """
        return takt_figures(self.seconds, self.takt_s) if self.seconds and self.timed else {}


class Console:
    """Observer of a run: its methods are called in the order of the events.

    A subclass overrides the methods that it needs, which must not raise.
    """

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        """Receives a change of phase; `node` is the index of the node, None where there is none."""

    def note(self, sentence: str) -> None:
        """Receives a message for people."""

    def step(self, part: int, step: Step) -> None:
        """Receives a squeeze that has ended."""

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Receives the result of a part."""

    def summary(self, tally: Tally, journal: Path) -> None:
        """Receives the totals of a run that has ended, and the path of its journal."""
