"""What the parts of a run came to, in numbers: a run of a week takes no more memory than one of a minute."""

from collections import Counter

from runtime.execution.results import Outcome, PartResult
from runtime.monitoring.console import Sighting


class Tally:
    """The sum over a run's parts.

    Attributes:
        parts: their number.
        outcomes: parts by outcome.
        squeezes: over all parts.
        exit_code: the gravest of the parts' codes, which are numbered by gravity; 0 if every part reached a
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
