"""The distributions that the control charts need, in the standard library alone."""

from math import comb, exp, lgamma, log, sqrt

Z95 = 1.959964
TINY = 1e-300
STEPS = 10_000


def wilson(successes: int, trials: int, z: float = Z95) -> tuple[float, float]:
    """Wilson's score interval of a share; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    share, z2 = successes / trials, z * z
    middle = share + z2 / (2 * trials)
    spread = z * sqrt(share * (1.0 - share) / trials + z2 / (4 * trials * trials))
    whole = 1.0 + z2 / trials
    low = 0.0 if successes == 0 else (middle - spread) / whole
    return low, 1.0 if successes == trials else (middle + spread) / whole


def binomial_tail(least: int, trials: int, share: float) -> float:
    """Probability of at least so many among so many trials."""
    if least <= 0:
        return 1.0
    if least > trials:
        return 0.0
    return min(
        1.0, sum(comb(trials, k) * share**k * (1.0 - share) ** (trials - k) for k in range(least, trials + 1))
    )


def chi_square_tail(statistic: float, freedom: int) -> float:
    """Probability that a chi-square variable exceeds the statistic.

    The regularised incomplete gamma function, by its series below and its continued fraction above the
    mean (Abramowitz and Stegun, 6.5.29 and 6.5.31, the latter by Lentz's method).
    """
    if freedom <= 0 or statistic <= 0.0:
        return 1.0
    a, x = 0.5 * freedom, 0.5 * statistic
    scale = exp(a * log(x) - x - lgamma(a))
    return 1.0 - scale * _series(a, x) if x < a + 1.0 else scale * _fraction(a, x)


def _series(a: float, x: float) -> float:
    term = total = 1.0 / a
    for k in range(1, STEPS):
        term *= x / (a + k)
        total += term
        if term < 1e-16 * total:
            break
    return total


def _fraction(a: float, x: float) -> float:
    b = x + 1.0 - a
    c, d = 1.0 / TINY, 1.0 / b
    value = d
    for k in range(1, STEPS):
        numerator = -k * (k - a)
        b += 2.0
        d = 1.0 / (numerator * d + b or TINY)
        c = b + numerator / c or TINY
        value *= d * c
        if abs(d * c - 1.0) < 1e-15:
            break
    return value
