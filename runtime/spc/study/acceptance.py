"""Acceptance of a cell: is the share of parts that it fails below a limit? To be looked at after any part.

A part is good if it came to a resolved leaf and its audit passed. One that was rejected, unresolved, a fault
or judged wrong failed; one that came to a leaf and was not judged is not known, and counts against whichever
verdict it might speak for. Parts that the operator stopped are left out.

The verdict is a sequential test by a confidence sequence: for a share m, ((s / m)^S ((1 - s) / (1 - m))^(n-S)
mixed over a beta distribution of s exceeds 1 / ERROR at any of the n with probability ERROR at most (Ville
1939; Howard, Ramdas, McAuliffe and Sekhon, Annals of Statistics 49, 2021, section 3.2). So it may be looked
at after each part and the study ended as soon as it is decided, and a wrong verdict still has probability
ERROR at most.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from math import ceil, lgamma, log, log1p
from typing import NamedTuple

from runtime.spc.charts import binomial_at_most
from runtime.spc.history import Part

ERROR = 0.05  # chance that a verdict is ever wrong, however often it is looked at
POWER = 0.9  # chance of being accepted that a number of parts is planned for
MOST_PARTS = 10_000_000
LEFT_OUT = frozenset({"stopped", "aborted", ""})
_SHAPE = 0.5


class Verdict(StrEnum):
    """What a study has come to."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    OPEN = "not decided yet"


class Bounds(NamedTuple):
    """A share, and what it is with confidence 1 - `ERROR` at any look."""

    low: float
    share: float
    high: float


@dataclass(frozen=True, slots=True)
class SequentialTest:
    """The sequential test of a share against a limit."""

    limit: float  # share of failures that is to be undercut, between 0 and 1

    def evidence(self, failures: int, parts: int, share: float) -> float:
        """Logarithm of the mixture's likelihood ratio against a share of failures."""
        a, b = _SHAPE, _SHAPE * (1.0 - self.limit) / self.limit  # most sensitive about the limit
        mixed = _beta(a + failures, b + parts - failures) - _beta(a, b)
        return mixed - _times_log(failures, share) - (parts - failures) * log1p(-share)

    def accepts(self, failures: int, parts: int) -> bool:
        """Whether so many failures show that their share is below the limit."""
        below = failures < self.limit * parts
        return below and self.evidence(failures, parts, self.limit) >= -log(ERROR)

    def refuses(self, failures: int, parts: int) -> bool:
        """Whether they show that it is above."""
        above = failures > self.limit * parts
        return above and self.evidence(failures, parts, self.limit) >= -log(ERROR)

    def bounds(self, least: int, most: int, parts: int) -> Bounds:
        """Bounds of the share, where between `least` and `most` of the parts failed."""
        if not parts:
            return Bounds(0.0, 0.0, 1.0)
        low = self._crossing(least, parts, 0.0, least / parts) if least else 0.0
        high = self._crossing(most, parts, 1.0, most / parts) if most < parts else 1.0
        return Bounds(low, least / parts, high)

    def _crossing(self, failures: int, parts: int, outside: float, inside: float) -> float:
        """Between a share that is ruled out and one that is not, where that changes; by bisection."""
        for _ in range(60):
            middle = 0.5 * (outside + inside)
            if 0.0 < middle < 1.0 and self.evidence(failures, parts, middle) < -log(ERROR):
                inside = middle
            else:
                outside = middle
        return outside


@dataclass(frozen=True, slots=True)
class Acceptance:
    """What the parts of a study have come to so far."""

    limit: float
    parts: int = 0  # those that count
    failed: int = 0
    unknown: int = 0
    verdict: Verdict = Verdict.OPEN
    decided_at: int | None = None  # number of parts at which the verdict came

    @property
    def bounds(self) -> Bounds:
        """Of the share of failures."""
        return SequentialTest(self.limit).bounds(
            self.failed, self.failed + self.unknown, self.parts
        )

    def fields(self) -> dict[str, object]:
        """For JSON."""
        return {
            "verdict": self.verdict.value,
            "decided_at": self.decided_at,
            "required": 1.0 - self.limit,
            "counted": self.parts,
            "good": self.parts - self.failed - self.unknown,
            "failed": self.failed,
            "not_known": self.unknown,
            "confidence": 1.0 - ERROR,
        }


def followed(parts: Iterable[Part], limit: float) -> Iterator[Acceptance]:
    """What a study has come to after each part that counts; a verdict, once there, stays."""
    test, now = SequentialTest(limit), Acceptance(limit)
    for part in parts:
        if part.outcome in LEFT_OUT:
            continue
        judged = part.outcome == "leaf" and part.verdict in ("pass", "fail")
        unknown = part.outcome == "leaf" and not judged
        failed = not unknown and part.verdict != "pass"
        count, failures, open_ = now.parts + 1, now.failed + failed, now.unknown + unknown
        verdict, at = now.verdict, now.decided_at
        if verdict is Verdict.OPEN:
            if test.accepts(failures + open_, count):
                verdict, at = Verdict.ACCEPTED, count
            elif test.refuses(failures, count):
                verdict, at = Verdict.REFUSED, count
        now = Acceptance(limit, count, failures, open_, verdict, at)
        yield now


class Planned(NamedTuple):
    """How many parts a study takes."""

    least: int  # without a single failure
    likely: int | None  # with probability `POWER`; None where no number would do


def planned(limit: float, expected: float | None) -> Planned:
    """How many parts to run before a cell is accepted.

    Args:
        limit: share of failures that is to be undercut.
        expected: share of the cell's failures; None where it is not known.
    """
    test = SequentialTest(limit)
    least = _first(lambda count: test.accepts(0, count)) or MOST_PARTS
    if expected is None or expected >= limit:
        return Planned(least, None)
    return Planned(
        least, _first(lambda count: binomial_at_most(_most(test, count), count, expected) >= POWER)
    )


def parts_for(readings: int, share: float, probability: float = 0.95) -> int | None:
    """How many parts to run so that, with a probability, so many of them are of a kind with this share."""
    return _first(lambda count: binomial_at_most(readings - 1, count, share) <= 1.0 - probability)


def _most(test: SequentialTest, count: int) -> int:
    """Greatest number of failures with which so many parts are accepted; -1 for none."""
    low, high = -1, ceil(test.limit * count)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if test.accepts(middle, count) else (low, middle)
    return low


def _first(does: Callable[[int], bool]) -> int | None:
    """The first number of parts that does, by doubling and bisection; None for none up to `MOST_PARTS`."""
    high = 1
    while not does(high):
        high *= 2
        if high > MOST_PARTS:
            return None
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if does(middle) else (middle, high)
    return high


def _beta(a: float, b: float) -> float:
    """Logarithm of the beta function."""
    return lgamma(a) + lgamma(b) - lgamma(a + b)


def _times_log(count: int, share: float) -> float:
    return count * log(share) if count else 0.0
