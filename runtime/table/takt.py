"""Distribution of the times of parts: mean, percentiles, and the share within a takt."""

from collections.abc import Mapping
from math import ceil, fsum

PERCENTILES = (50, 95, 99)


def figures(seconds: Mapping[float, int], takt_s: float | None = None) -> dict[str, float]:
    """Mean, percentiles and maximum of times; with a takt, the share within it.

    Args:
        seconds: number of parts for each time, at least one part.
        takt_s: the takt.

    Returns:
        `seconds_mean`, `seconds_p50`, `seconds_p95`, `seconds_p99`, `seconds_max` and, with a takt, `takt_s`
        and `takt_probability`. A percentile is the least time within which that share of the parts is done.
    """
    parts, rising = sum(seconds.values()), sorted(seconds.items())
    summary = {"seconds_mean": fsum(taken * many for taken, many in rising) / parts}
    for percentile in PERCENTILES:
        summary[f"seconds_p{percentile}"] = _within(rising, ceil(percentile * parts / 100))
    summary["seconds_max"] = rising[-1][0]
    if takt_s is not None:
        done = sum(many for taken, many in rising if taken <= takt_s)
        summary |= {"takt_s": takt_s, "takt_probability": done / parts}
    return summary


def text(summary: Mapping[str, float]) -> str:
    """The share of parts done within the takt, as text: "98.21% done within 6 s"."""
    return f"{summary['takt_probability']:.2%} done within {summary['takt_s']:g} s"


def _within(rising: list[tuple[float, int]], parts: int) -> float:
    """The least time within which `parts` parts are done, from rising pairs of a time and its parts."""
    done = 0
    for taken, many in rising:
        done += many
        if done >= parts:
            return taken
    return rising[-1][0]
