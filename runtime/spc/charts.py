"""Control charts: each receives the values of part after part, and alarms when the cell has changed.

With the limits in this module, the charts together raise less than one false alarm in ten thousand parts.
An alarm resets its chart. So a fault that persists raises another alarm, and a repaired fault does not.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import erfc, exp, lgamma, log, log1p, sqrt

WINDOW = 50  # parts over which shares are taken
# parts over which frequencies of branches are taken: the short window detects large changes soon, the
# long window detects small changes
WINDOWS = (50, 200)
RARE = 1e-5  # false-alarm probability of a window
# false-alarm probability of a window of frequencies of branches; the chi-square distribution is too
# inexact for a smaller probability
UNLIKELY = 2e-5
LEAST_EXPECTED = 3.0  # least expected count of a branch; branches that expect less are pooled
# largest deviation that counts in full, in standard deviations: a single outlier is a failure, not a drift
CLIP = 3.0


@dataclass(slots=True)
class Cusum:
    """CUSUM chart: alarms when the mean of deviations shifts up or down (Page, Biometrika 41, 1954).

    Each deviation adds the logarithm of a likelihood ratio: the deviation's likelihood if the mean has
    shifted, divided by its likelihood if not. The ratio depends on the deviation's standard deviation: a
    deviation with large scatter adds little.
    """

    shift: float  # shift to be detected, in the unit of the deviations
    limit: float = 12.0  # log-likelihood ratio at which the chart alarms
    up: float = 0.0  # sum of log-likelihood ratios for a shift upwards
    down: float = 0.0  # the same sum for a shift downwards

    def add(self, deviation: float, sigma: float) -> bool:
        """Adds one deviation and its standard deviation; returns whether the chart alarms."""
        clipped = min(max(deviation, -CLIP * sigma), CLIP * sigma)
        weight = self.shift / (sigma * sigma)
        self.up = max(0.0, self.up + weight * (clipped - 0.5 * self.shift))
        self.down = max(0.0, self.down + weight * (-clipped - 0.5 * self.shift))
        if max(self.up, self.down) < self.limit:
            return False
        self.up = self.down = 0.0
        return True


@dataclass(slots=True)
class Ewma:
    """EWMA chart: alarms when the exponentially weighted mean of values is far from zero.

    The values are standardised: of mean 0 and standard deviation 1 (Roberts, Technometrics 1, 1959).
    """

    weight: float = 0.1  # weight of the newest value
    width: float = 5.0  # distance of the limits from zero, in standard deviations of the mean
    mean: float = 0.0

    @property
    def limit(self) -> float:
        """The chart alarms when the absolute value of its mean reaches this limit."""
        return self.width * sqrt(self.weight / (2.0 - self.weight))

    def add(self, value: float) -> bool:
        """Adds one value; returns whether the chart alarms."""
        clipped = min(max(value, -CLIP), CLIP)
        self.mean += self.weight * (clipped - self.mean)
        if abs(self.mean) < self.limit:
            return False
        self.mean = 0.0
        return True


@dataclass(slots=True)
class BinomialWindowChart:
    """Alarms when more of the last `WINDOW` parts have a property than is expected (binomial test)."""

    expected: float  # share of parts that are expected to have the property
    recent: deque[bool] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def add(self, had: bool) -> bool:
        """Adds one part, given whether the part had the property; returns whether the chart alarms."""
        self.recent.append(had)
        if not had or binomial_tail(sum(self.recent), len(self.recent), self.expected) > RARE:
            return False
        self.recent.clear()
        return True


@dataclass(slots=True)
class GTestChart:
    """Alarms when the shares of branches among the last `window` parts are not as predicted (G test)."""

    shares: Sequence[Sequence[float]]  # predicted share of each branch of each node
    window: int  # number of parts
    recent: deque[tuple[tuple[int, int], ...]] = field(init=False)

    def __post_init__(self) -> None:
        self.recent = deque(maxlen=self.window)

    def add(self, taken: tuple[tuple[int, int], ...]) -> bool:
        """Adds one part, given the branches that it took; returns whether the chart alarms.

        Args:
            taken: for each squeeze of the part, the indices of node and branch.
        """
        self.recent.append(taken)
        if len(self.recent) < self.window // 2 or self._tail() > UNLIKELY:
            return False
        self.recent.clear()
        return True

    def _tail(self) -> float:
        """Probability of counts at least as unlikely as those in the window, if the shares are right.

        The statistic of the test is the sum of the G statistics of all nodes.
        """
        counts = [[0] * len(shares) for shares in self.shares]
        for part in self.recent:
            for node, branch in part:
                counts[node][branch] += 1
        statistics, freedoms = zip(*map(likelihood_ratio, counts, self.shares), strict=True)
        return chi_square_tail(sum(statistics), sum(freedoms))


def chi_square(counts: Sequence[int], shares: Sequence[float]) -> tuple[float, int]:
    """Compares counts with expected shares; returns Pearson's statistic and its degrees of freedom.

    The shares need not add up to 1.
    """
    filled = _cells(counts, shares)
    statistic = sum((seen - expected) ** 2 / expected for seen, expected in filled)
    return statistic, max(len(filled) - 1, 0)


def likelihood_ratio(counts: Sequence[int], shares: Sequence[float]) -> tuple[float, int]:
    """Compares counts with expected shares; returns the G statistic and its degrees of freedom.

    The G statistic is twice the logarithm of the likelihood ratio. In short windows the G statistic
    detects a missing branch far sooner than Pearson's statistic.
    """
    filled = _cells(counts, shares)
    gain = 2.0 * sum(seen * log(seen / expected) for seen, expected in filled if seen > 0.0)
    return max(gain, 0.0), max(len(filled) - 1, 0)


def _cells(counts: Sequence[int], shares: Sequence[float]) -> list[tuple[float, float]]:
    """Returns pairs of an observed and an expected count, one for each branch.

    Branches with an expected count below `LEAST_EXPECTED` are pooled into one pair. If the expected count
    of this pair is still too low, the pair is added to the smallest of the other pairs. The list is empty if
    all counts or all shares are 0.
    """
    total, whole = sum(counts), sum(shares)
    if total == 0 or whole <= 0.0:
        return []
    filled: list[tuple[float, float]] = []
    rest_seen, rest_expected = 0.0, 0.0
    for seen, share in zip(map(float, counts), shares, strict=True):
        expected = total * share / whole
        if expected >= LEAST_EXPECTED:
            filled.append((seen, expected))
        else:
            rest_seen, rest_expected = rest_seen + seen, rest_expected + expected
    if rest_expected >= LEAST_EXPECTED or not filled:
        filled.append((rest_seen, rest_expected))
    elif rest_expected > 0.0:
        # Pooled branches that still expect too few parts join the smallest pair: alone they would be noise.
        smallest = min(range(len(filled)), key=lambda k: filled[k][1])
        filled[smallest] = (filled[smallest][0] + rest_seen, filled[smallest][1] + rest_expected)
    return filled


def binomial_tail(least: int, trials: int, share: float) -> float:
    """Probability of at least `least` successes in `trials` trials; `share` is the chance of each success."""
    return binomial_at_most(trials - least, trials, 1.0 - share)


def binomial_at_most(most: int, trials: int, share: float) -> float:
    """Probability of at most `most` successes in `trials` trials; `share` is the chance of each success."""
    if most < 0 or share >= 1.0:
        return float(most >= trials)
    if share <= 0.0 or most >= trials:
        return 1.0
    ways, yes, no = lgamma(trials + 1), log(share), log1p(-share)
    terms = (
        exp(ways - lgamma(k + 1) - lgamma(trials - k + 1) + k * yes + (trials - k) * no)
        for k in range(most + 1)
    )
    return min(1.0, sum(terms))


def chi_square_tail(statistic: float, freedom: int) -> float:
    """Probability that a chi-square variable exceeds a statistic; 1 without degrees of freedom.

    The probability is computed as a finite sum (Abramowitz and Stegun, 26.4.4 and 26.4.5).

    Args:
        statistic: the value to exceed.
        freedom: number of degrees of freedom.
    """
    if freedom <= 0 or statistic <= 0.0:
        return 1.0
    x = 0.5 * statistic
    a, tail = (0.5, erfc(sqrt(x))) if freedom % 2 else (1.0, exp(-x))
    while a < 0.5 * freedom:
        tail += exp(a * log(x) - x - lgamma(a + 1.0))
        a += 1.0
    return min(tail, 1.0)
