"""What the charts of a report show: one value after the other, with limits."""

from collections.abc import Sequence
from math import log1p
from typing import NamedTuple

from runtime.spc.charts import RARE, Cusum, Ewma
from runtime.spc.distributions import binomial_tail, wilson
from runtime.spc.expectation import LIMIT, Expectation, ShiryaevRoberts
from runtime.spc.history import History
from runtime.spc.monitor import LEAST_SHARE, WIDTH_SHIFT_UM, deviation, standardised
from runtime.table import PPM

GROUP = 50  # audited parts of one point of the p-chart


class Series(NamedTuple):
    """One chart.

    Attributes:
        title: what it shows.
        lines: named values, one for each step.
        limits: values that no line may pass.
        step: what a step is.
    """

    title: str
    lines: tuple[tuple[str, tuple[float, ...]], ...]
    limits: tuple[float, ...]
    step: str


def all_series(history: History, expected: Expectation | None = None) -> tuple[Series, ...]:
    """The charts of a report."""
    found = (failures(history), residuals(history), widths(history))
    return found if expected is None else (*found, readings(history, expected))


def failures(history: History) -> Series:
    """Shares of failures in groups of audited parts: the p-chart."""
    judged = [part.verdict == "fail" for part in history.parts if part.verdict in ("pass", "fail")]
    groups = [judged[k : k + GROUP] for k in range(0, len(judged), GROUP)]
    predicted = history.table.predicted
    _, worst = wilson(round((1.0 - predicted.success_ppm / PPM) * predicted.trials), predicted.trials)
    expected = max(worst, LEAST_SHARE)
    most = next(k for k in range(GROUP + 1) if binomial_tail(k, GROUP, expected) < RARE or k == GROUP)
    shares = tuple(sum(group) / len(group) for group in groups)
    return Series(
        f"failures, share of each {GROUP} audited parts", (("failures", shares),), (most / GROUP,), "group"
    )


def residuals(history: History) -> Series:
    """Weighted means of the residuals in units of their leaves' standard deviations."""
    charts = (Ewma(), Ewma(), Ewma())
    values: tuple[list[float], list[float], list[float]] = ([], [], [])
    for part in history.parts:
        for chart, line, value in zip(charts, values, standardised(history.table, part), strict=False):
            chart.add(value)
            line.append(chart.mean)
    limit = charts[0].limit
    lines = tuple((name, tuple(line)) for name, line in zip(("x", "y", "theta"), values, strict=True))
    return Series("residuals, weighted means in standard deviations", lines, (-limit, limit), "audited part")


def widths(history: History) -> Series:
    """Cumulative sums of the widths' deviations."""
    chart = Cusum(WIDTH_SHIFT_UM)
    up, down = [], []
    for part in history.parts:
        for squeeze in part.squeezes:
            chart.add(*deviation(history.table, squeeze))
            up.append(chart.up)
            down.append(-chart.down)
    lines = (("wider", tuple(up)), ("narrower", tuple(down)))
    return Series("widths, cumulative sums of deviations", lines, (-chart.limit, chart.limit), "squeeze")


def readings(history: History, expected: Expectation) -> Series:
    """How much likelier the readings are at another friction than at the planned one."""
    chart, line = ShiryaevRoberts(expected), []
    for part in history.parts:
        alarm = chart.add(history.table, part)
        line.append(log1p(LIMIT if alarm else chart.value))
    title = "readings, logarithm of the Shiryaev-Roberts statistic for another friction"
    return Series(title, (("friction", tuple(line)),), (log1p(LIMIT),), "part")


def thinned(values: Sequence[float], most: int = 1200) -> list[tuple[int, float]]:
    """Thin values for drawing: of each stretch, the value farthest from zero."""
    stretch = max(1, -(-len(values) // most))
    found = []
    for start in range(0, len(values), stretch):
        index = max(range(start, min(start + stretch, len(values))), key=lambda k: abs(values[k]))
        found.append((index, values[index]))
    return found
