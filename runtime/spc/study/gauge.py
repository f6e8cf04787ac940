"""Studies of a gauge: type-1 studies, and crossed studies of repeatability and reproducibility (gauge R&R).

A type-1 study compares repeated readings of a known reference with a tolerance (bias, Cg, Cgk). Its formulas
are those of VDA volume 5: Cg is a fifth of the tolerance divided by six standard deviations. In a crossed
study several appraisers measure the same parts several times. Its formulas and constants are those of AIAG,
Measurement Systems Analysis, 4th edition 2010, chapter III.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, lgamma, log, log1p, sqrt
from statistics import fmean, stdev
from typing import NamedTuple

LEAST_READINGS = 25  # least readings of a type-1 study
CAPABLE = 1.33  # Cg and Cgk from which a gauge counts as capable
GOOD, ACCEPTABLE = 10.0, 30.0  # %GRR up to which a gauge is good, and up to which it is acceptable
# probability of the interaction by chance, from which the interaction counts as repeatability
POOLED_FROM = 0.05
# factor from the ratio of part to gauge variation to the number of categories (AIAG)
CATEGORIES = 1.41
# Constants 1 / d2* of AIAG, by number of trials (K1), of appraisers (K2) and of parts (K3).
K1 = {2: 0.8862, 3: 0.5908}
K2 = {2: 0.7071, 3: 0.5231}
K3 = dict(enumerate((0.7071, 0.5231, 0.4467, 0.4030, 0.3742, 0.3534, 0.3375, 0.3249, 0.3146), 2))


class TypeOne(NamedTuple):
    """Results of a type-1 study, which compares repeated readings with a reference; None: undefined."""

    readings: int  # number of readings
    bias: float  # mean deviation: gauge minus reference, in the unit of the readings
    sigma: float | None  # standard deviation of the readings
    cg: float | None  # repeatability against the tolerance
    cgk: float | None  # repeatability and bias against the tolerance
    bias_p: float | None  # probability of such a bias by chance (Student's t)

    @property
    def capable(self) -> bool | None:
        """Whether both Cg and Cgk reach `CAPABLE`; None if the readings are too few or all equal."""
        if self.readings < LEAST_READINGS or self.cg is None or self.cgk is None:
            return None
        return min(self.cg, self.cgk) >= CAPABLE


def type_one(deviations: Sequence[float], tolerance: float) -> TypeOne:
    """Evaluates a type-1 study.

    Args:
        deviations: readings of the gauge minus the reference, at least one.
        tolerance: whole width of the tolerance, in the unit of the deviations.
    """
    count, bias = len(deviations), fmean(deviations)
    if count < 2:
        return TypeOne(count, bias, None, None, None, None)
    sigma = stdev(deviations)
    if sigma == 0.0:
        return TypeOne(count, bias, sigma, None, None, None)
    cg, cgk = 0.2 * tolerance / (6.0 * sigma), (0.1 * tolerance - abs(bias)) / (3.0 * sigma)
    return TypeOne(count, bias, sigma, cg, cgk, t_tail(bias * sqrt(count) / sigma, count - 1))


class Spread(NamedTuple):
    """Standard deviations that a crossed study (gauge R&R) estimates, in the unit of its readings."""

    repeatability: float  # EV: readings of one part by one appraiser
    # AV: between appraisers; includes their interaction with parts if it is significant
    reproducibility: float
    part: float  # PV: between parts

    @property
    def gauge(self) -> float:
        """GRR: standard deviation of repeatability and reproducibility together."""
        return sqrt(self.repeatability**2 + self.reproducibility**2)

    @property
    def total(self) -> float:
        """TV: standard deviation of gauge and parts together."""
        return sqrt(self.gauge**2 + self.part**2)

    def percent(self, value: float) -> float | None:
        """Converts a standard deviation to percent of the total; None if all readings were equal."""
        return 100.0 * value / self.total if self.total else None

    @property
    def categories(self) -> float | None:
        """Number of categories of parts that the gauge can distinguish (ndc), not rounded.

        None if the gauge never varied.
        """
        return CATEGORIES * self.part / self.gauge if self.gauge else None

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
        names = ("repeatability", "reproducibility", "gauge", "part")
        named = {name: getattr(self, name) for name in names}
        percent = {f"{name}_percent": self.percent(value) for name, value in named.items()}
        ndc = self.categories
        whole = None if ndc is None else max(int(ndc), 1)
        return {**named, "total": self.total, **percent, "ndc": whole, "ndc_unrounded": ndc}


Readings = Sequence[Sequence[Sequence[float]]]


@dataclass(frozen=True, slots=True)
class Crossed:
    """Results of a crossed study (gauge R&R), by analysis of variance and by average and range."""

    parts: int  # number of parts
    appraisers: int  # number of appraisers
    trials: int  # number of readings of each part by each appraiser
    # probability of such an interaction of appraisers and parts by chance; None if repeated readings never
    # differ
    interaction_p: float | None
    anova: Spread  # by analysis of variance
    ranges: Spread | None  # by average and range; None if AIAG states no constants for this size

    def fields(self) -> dict[str, object]:
        """Converts the object to JSON types."""
        return {
            "parts": self.parts,
            "appraisers": self.appraisers,
            "trials": self.trials,
            "interaction_p": self.interaction_p,
            "anova": self.anova.fields(),
            "average_and_range": None if self.ranges is None else self.ranges.fields(),
        }

    @property
    def percent(self) -> float | None:
        """%GRR: the gauge's standard deviation in percent of the total, by analysis of variance.

        None if all readings were equal.
        """
        return self.anova.percent(self.anova.gauge)


def crossed(readings: Readings) -> Crossed:
    """Evaluates a crossed study (gauge R&R): several appraisers measure the same parts several times.

    Args:
        readings: readings of shape (parts, appraisers, trials).

    Raises:
        ValueError: a dimension is less than 2, or the study is not balanced.
    """
    parts, appraisers = len(readings), len(readings[0]) if readings else 0
    trials = len(readings[0][0]) if appraisers else 0
    if min(parts, appraisers, trials) < 2:
        size = f"{parts} parts, {appraisers} appraisers, {trials} trials"
        raise ValueError(f"{size}: a crossed study has at least two of each")
    sizes = {(len(cells), len(cell)) for cells in readings for cell in cells}
    if sizes != {(appraisers, trials)} or not all(readings):
        raise ValueError("each appraiser measures each part equally often in a crossed study")
    tail, spread = _analysis(readings, parts, appraisers, trials)
    return Crossed(parts, appraisers, trials, tail, spread, _average_and_range(readings))


def _analysis(readings: Readings, p: int, o: int, r: int) -> tuple[float | None, Spread]:
    """Evaluates a crossed study by two-way analysis of variance.

    An interaction of appraisers and parts that is not significant counts as repeatability.

    Args:
        readings: readings of shape (p, o, r).
        p: number of parts.
        o: number of appraisers.
        r: number of trials.

    Returns:
        The probability that chance alone makes the interaction as large as observed or larger (None if
        repeated readings never differ), and the standard deviations.
    """
    cells = [[fmean(cell) for cell in row] for row in readings]
    rows, columns = [*map(fmean, cells)], [*map(fmean, zip(*cells, strict=True))]
    mean = fmean(rows)
    within = sum(
        (x - cells[i][j]) ** 2
        for i, row in enumerate(readings)
        for j, cell in enumerate(row)
        for x in cell
    )
    between_parts = o * r * sum((x - mean) ** 2 for x in rows)
    between_appraisers = p * r * sum((x - mean) ** 2 for x in columns)
    off = (cells[i][j] - rows[i] - columns[j] + mean for i in range(p) for j in range(o))
    both = r * sum(each**2 for each in off)
    free_both, free_within = (p - 1) * (o - 1), p * o * (r - 1)
    error, noise = both / free_both, within / free_within
    tail = f_tail(error / noise, free_both, free_within) if within else None
    if tail is None or tail < POOLED_FROM:
        interaction = max((error - noise) / r, 0.0)
    else:
        error = noise = (both + within) / (free_both + free_within)
        interaction = 0.0
    part = max((between_parts / (p - 1) - error) / (o * r), 0.0)
    appraiser = max((between_appraisers / (o - 1) - error) / (p * r), 0.0)
    return tail, Spread(sqrt(noise), sqrt(appraiser + interaction), sqrt(part))


def _average_and_range(readings: Readings) -> Spread | None:
    p, o, r = len(readings), len(readings[0]), len(readings[0][0])
    if r not in K1 or o not in K2 or p not in K3:
        return None
    repeatability = fmean(max(cell) - min(cell) for row in readings for cell in row) * K1[r]
    columns = [fmean(fmean(row[j]) for row in readings) for j in range(o)]
    rows = [fmean(fmean(cell) for cell in row) for row in readings]
    apart = (max(columns) - min(columns)) * K2[o]
    reproducibility = sqrt(max(apart**2 - repeatability**2 / (p * r), 0.0))
    return Spread(repeatability, reproducibility, (max(rows) - min(rows)) * K3[p])


def f_tail(statistic: float, above: int, below: int) -> float:
    """Probability that an F-distributed variable exceeds a statistic.

    Args:
        statistic: the value to exceed.
        above: degrees of freedom of the numerator.
        below: degrees of freedom of the denominator.
    """
    return beta_share(below / (below + above * statistic), below / 2, above / 2)


def t_tail(statistic: float, freedom: int) -> float:
    """Probability that a t-distributed variable exceeds a statistic in absolute value.

    Args:
        statistic: the value to exceed.
        freedom: degrees of freedom.
    """
    return beta_share(freedom / (freedom + statistic**2), freedom / 2, 0.5)


def beta_share(x: float, a: float, b: float) -> float:
    """The regularised incomplete beta function I_x(a, b).

    It is computed by its continued fraction (Abramowitz and Stegun, 26.5.8).
    """
    if x <= 0.0 or x >= 1.0:
        return float(x >= 1.0)
    if x > (a + 1.0) / (a + b + 2.0):  # here the fraction of 1 - I converges faster
        return 1.0 - beta_share(1.0 - x, b, a)
    front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log1p(-x)) / a
    above, below = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    fraction = below
    for m in range(1, 500):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            below, above = 1.0 / (1.0 + term * below), 1.0 + term / above
            fraction *= below * above
        if abs(below * above - 1.0) < 1e-15:
            break
    return front * fraction
