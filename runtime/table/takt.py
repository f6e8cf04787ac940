"""Distribution of the times that parts take: mean, percentiles, and the share done within a takt."""

from bisect import bisect_left
from collections.abc import Mapping
from itertools import accumulate
from math import ceil, fsum

PERCENTILES = (50, 95, 99)


def figures(seconds: Mapping[float, int], takt_s: float | None = None) -> dict[str, float]:
    """Mean, percentiles and maximum of the parts' times; with a takt, the share of parts done within it.

    Args:
        seconds: number of parts for each time, at least one part.
        takt_s: time within which a part should be done.

    Returns:
        `seconds_mean`, `seconds_p50`, `seconds_p95`, `seconds_p99`, `seconds_max` and, with a takt, `takt_s`
        and `takt_probability`. A percentile is the least time within which that share of the parts is done.
    """
    parts, rising = sum(seconds.values()), sorted(seconds.items())
    summary = {"seconds_mean": fsum(taken * many for taken, many in rising) / parts}
    done = list(accumulate(many for _, many in rising))
    for percentile in PERCENTILES:
        within = bisect_left(done, ceil(percentile * parts / 100))
        summary[f"seconds_p{percentile}"] = rising[within][0]
    summary["seconds_max"] = rising[-1][0]
    if takt_s is not None:
        in_takt = sum(many for taken, many in rising if taken <= takt_s)
        summary |= {"takt_s": takt_s, "takt_probability": in_takt / parts}
    return summary


def text(summary: Mapping[str, float]) -> str:
    """The share of parts done within the takt, as text: "98.21% done within 6 s"."""
    return f"{summary['takt_probability']:.2%} done within {summary['takt_s']:g} s"
