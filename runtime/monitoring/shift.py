"""What a shift comes to: yield, seconds against the takt, and what costs the most parts."""

from collections.abc import Sequence
from typing import NamedTuple

from runtime.devices.clock import SystemClock
from runtime.traversal.results import Outcome, PartResult

CHANGES = (6, 14, 22)  # hours of the day, local time
SHOWN_LOSSES = 6


class Loss(NamedTuple):
    """Parts that were lost in the same way after as many squeezes; what is said of one is of the latest."""

    kind: str  # an outcome, "audit" or "delivery"
    squeeze: int  # how many there were
    node: int | None  # of the last squeeze; None without one
    width_mm: float | None  # that was read there
    reason: str
    part: int
    parts: int


class Shift:
    """Counts since the latest change of shift or, where that was before, since the run began.

    Args:
        changes: hours of the day at which shifts change, local time.
        takt_s: seconds within which a part should be done.
        clock: tells the time of day.
    """

    def __init__(
        self, changes: Sequence[int], takt_s: float | None, clock: SystemClock | None = None
    ) -> None:
        self._changes, self._takt_s, self._clock = changes, takt_s, clock or SystemClock()
        self._begin(self._clock.shift(changes), self._clock.local())

    def _begin(self, change: str, since: str) -> None:
        self._change, self._since = change, since
        self._parts, self._good, self._timed, self._in_takt, self._seconds = 0, 0, 0, 0, 0.0
        self._losses: dict[tuple[str, int], Loss] = {}

    def _renew(self) -> None:
        change = self._clock.shift(self._changes)
        if change != self._change:
            self._begin(change, change)

    def add(self, result: PartResult) -> None:
        """One part's end."""
        self._renew()
        self._parts += 1
        if result.seconds:
            self._timed += 1
            self._seconds += result.seconds
            self._in_takt += self._takt_s is not None and result.seconds <= self._takt_s
        kind = _kind(result)
        if kind is None:
            self._good += 1
            return
        node, width_mm, squeeze = None, None, len(result.steps)
        if result.steps:
            node, width_mm = result.steps[-1].node, result.steps[-1].width_um / 1000
        before = self._losses[kind, squeeze].parts if (kind, squeeze) in self._losses else 0
        self._losses[kind, squeeze] = Loss(
            kind, squeeze, node, width_mm, result.reason or "", result.part, before + 1
        )

    def as_object(self) -> dict[str, object]:
        """The counts as JSON holds them; `losses` begins with what costs the most parts."""
        self._renew()
        losses = sorted(self._losses.values(), key=lambda loss: -loss.parts)[:SHOWN_LOSSES]
        timed = self._timed
        return {
            "since": self._since,
            "parts": self._parts,
            "good": self._good,
            "seconds_mean": round(self._seconds / timed, 3) if timed else None,
            "takt_s": self._takt_s,
            "takt_share": self._in_takt / timed if timed and self._takt_s is not None else None,
            "losses": [loss._asdict() for loss in losses],
        }


def _kind(result: PartResult) -> str | None:
    """In which way a part was lost; None where it was not."""
    if result.outcome is not Outcome.LEAF:
        return str(result.outcome.value)
    if result.audit == "fail":
        return "audit"
    return "delivery" if result.delivery == "missed" else None
