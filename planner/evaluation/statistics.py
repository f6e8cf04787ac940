"""Confidence intervals of rates (Wilson 1927)."""

import math

Z95 = 1.959963984540054


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % confidence interval of a rate; [0, 1] without any trials."""
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    scale = 1.0 + Z95 * Z95 / trials
    centre = (rate + Z95 * Z95 / (2 * trials)) / scale
    half = Z95 / scale * math.sqrt(rate * (1.0 - rate) / trials + Z95 * Z95 / (4 * trials * trials))
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == trials else min(1.0, centre + half)
    return low, high
