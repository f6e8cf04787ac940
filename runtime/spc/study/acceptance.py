"""Acceptance of a cell: tests, after any number of parts, whether the share of failed parts is below a limit.

A part is good if it ended at a resolved leaf and its audit passed. A part that was rejected, unresolved,
faulted or judged wrong has failed. A part that ended at a leaf but was not judged is unknown. The cell is
accepted only if it would be accepted with all unknown parts failed, and refused only if it would be refused
with all unknown parts good. Parts that the operator stopped, or that were given up (aborted), are left out.

The test is sequential. Let m be the true share of failures, s an assumed share, and S the number of failures
among the first n parts. Average the likelihood ratio (s / m)^S ((1 - s) / (1 - m))^(n - S) over a beta
distribution of s. The probability that this average ever exceeds 1 / ERROR, at whatever n, is at most ERROR
(Ville 1939; Howard, Ramdas, McAuliffe and Sekhon, Annals of Statistics 49, 2021, section 3.2). So the study
may be checked after each part and end with the first verdict: a wrong verdict has probability ERROR at most.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from math import ceil, lgamma, log, log1p
from typing import NamedTuple

from runtime.spc.charts import binomial_at_most
from runtime.spc.history import Part

ERROR = 0.05  # probability of a wrong verdict, however often the study is checked
POWER = 0.9  # probability of acceptance for which a number of parts is planned
# probability that a planned number of parts contains the readings that are required
CONTAINED = 0.95
MOST_PARTS = 10_000_000
LEFT_OUT = frozenset({"stopped", "aborted", ""})
_SHAPE = 0.5


class Verdict(StrEnum):
    """Verdict of an acceptance study: accepted, refused, or open while the parts are too few."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    OPEN = "not decided yet"


class Bounds(NamedTuple):
    """The observed share of failures, with confidence bounds of the true share.

    A study has such bounds after every part. With confidence 1 - `ERROR`, the true share is within all of
    them.
    """

    low: float  # lower bound
    share: float  # observed share
    high: float  # upper bound


@dataclass(frozen=True, slots=True)
class SequentialTest:
    """The sequential test whether the share of failures is below or above a limit."""

    limit: float  # largest acceptable share of failures, between 0 and 1

    def evidence(self, failures: int, parts: int, share: float) -> float:
        """Evidence against the assumption that the true share of failures is `share`.

        The evidence is the logarithm of the averaged likelihood ratio in the module's docstring. From
        -log(`ERROR`) on, the test excludes the share.

        Args:
            failures: number of failures, S.
            parts: number of parts, n.
            share: the assumed true share of failures, m.
        """
        # This beta distribution has the limit as its mean: the test is most sensitive about the limit.
        a, b = _SHAPE, _SHAPE * (1.0 - self.limit) / self.limit
        mixed = _beta(a + failures, b + parts - failures) - _beta(a, b)
        failed = failures * log(share) if failures else 0.0
        return mixed - failed - (parts - failures) * log1p(-share)

    def accepts(self, failures: int, parts: int) -> bool:
        """Whether a number of failures among a number of parts shows that the share is below the limit."""
        below = failures < self.limit * parts
        return below and self.evidence(failures, parts, self.limit) >= -log(ERROR)

    def refuses(self, failures: int, parts: int) -> bool:
        """Whether a number of failures among a number of parts shows that the share is above the limit."""
        above = failures > self.limit * parts
        return above and self.evidence(failures, parts, self.limit) >= -log(ERROR)

    def bounds(self, least: int, most: int, parts: int) -> Bounds:
        """Confidence bounds of the share of failures, if at least `least` and at most `most` parts failed."""
        if not parts:
            return Bounds(0.0, 0.0, 1.0)
        low = self._crossing(least, parts, 0.0, least / parts) if least else 0.0
        high = self._crossing(most, parts, 1.0, most / parts) if most < parts else 1.0
        return Bounds(low, least / parts, high)

    def _crossing(self, failures: int, parts: int, outside: float, inside: float) -> float:
        """Finds a confidence bound of the share of failures by bisection.

        Args:
            failures: number of failures.
            parts: number of parts.
            outside: a share that the test excludes, or 0 or 1.
            inside: a share that the test does not exclude.

        Returns:
            The share between `outside` and `inside` from which on the test excludes shares.
        """
        for _ in range(60):
            middle = 0.5 * (outside + inside)
            if 0.0 < middle < 1.0 and self.evidence(failures, parts, middle) < -log(ERROR):
                inside = middle
            else:
                outside = middle
        return outside


@dataclass(frozen=True, slots=True)
class Acceptance:
    """State of an acceptance study after some parts: counts, and the verdict so far."""

    limit: float  # largest acceptable share of failures
    parts: int = 0  # number of parts that count
    failed: int = 0
    unknown: int = 0  # number of parts at a leaf that were not judged
    verdict: Verdict = Verdict.OPEN
    decided_at: int | None = None  # number of parts at the verdict; None while open

    @property
    def bounds(self) -> Bounds:
        """Confidence bounds of the share of failures, after these parts."""
        most = self.failed + self.unknown
        return SequentialTest(self.limit).bounds(self.failed, most, self.parts)

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
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
    """Yields the state of an acceptance study after each part, except parts with an outcome in `LEFT_OUT`.

    Once the study has accepted or refused the cell, its verdict does not change any more.
    """
    test, now = SequentialTest(limit), Acceptance(limit)
    for part in parts:
        if part.outcome in LEFT_OUT:
            continue
        judged = part.outcome == "leaf" and part.verdict in ("pass", "fail")
        unknown = part.outcome == "leaf" and not judged
        failed = not unknown and not (part.outcome == "leaf" and part.verdict == "pass")
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
    """Numbers of parts after which a study accepts a cell."""

    least: int | None  # number of parts if no part fails; None if above `MOST_PARTS`
    # number of parts after which a cell is accepted with probability `POWER`; None if above `MOST_PARTS`, or
    # if the expected share of failures is unknown or not below the limit
    likely: int | None


def planned(limit: float, expected: float | None) -> Planned:
    """Computes how many parts a study needs until it accepts a cell.

    Args:
        limit: largest acceptable share of failures.
        expected: share of parts expected to fail in the cell; None: unknown.
    """
    test = SequentialTest(limit)
    least = _first(lambda count: test.accepts(0, count))
    if least is None or expected is None or expected >= limit:
        return Planned(least, None)
    likely = _first(lambda count: binomial_at_most(_most(test, count), count, expected) >= POWER)
    return Planned(least, likely)


def parts_for(readings: int, share: float) -> int | None:
    """Number of parts to run, so that at least `readings` are of one kind with probability `CONTAINED`.

    Args:
        readings: the least number of parts of this kind.
        share: share of the kind among all parts.

    Returns:
        The number of parts; None if it is above `MOST_PARTS`.
    """
    return _first(lambda count: binomial_at_most(readings - 1, count, share) <= 1.0 - CONTAINED)


def _most(test: SequentialTest, count: int) -> int:
    """Greatest number of failures among `count` parts that the test accepts; -1 if it accepts no number."""
    failures = range(ceil(test.limit * count))
    return bisect_left(failures, True, key=lambda each: not test.accepts(each, count)) - 1


def _first(does: Callable[[int], bool]) -> int | None:
    """Finds the least number of parts that satisfies a condition; all greater numbers should satisfy it, too.

    Returns None if the number is above `MOST_PARTS`.
    """
    high = 1
    while not does(high):
        if high == MOST_PARTS:
            return None
        high = min(2 * high, MOST_PARTS)
    return bisect_left(range(high), True, high // 2 + 1, key=does)


def _beta(a: float, b: float) -> float:
    """Logarithm of the beta function B(a, b)."""
    return lgamma(a) + lgamma(b) - lgamma(a + b)
