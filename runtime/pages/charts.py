"""Draws charts as HTML: their lines and bars as SVG, which scales with the page, and their labels as text."""

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

MOST_POINTS = 1200  # most points that are drawn for a line
APART = 9.0  # least distance of two labels of a histogram, percent of the histogram's width


class Line(NamedTuple):
    """A line of a chart: its name, and its value at each step."""

    name: str
    values: Sequence[float]  # in the order of the steps


class Bar(NamedTuple):
    """A bar of a bar chart."""

    name: str
    amount: float  # length of the bar
    text: str  # the amount as it is written beside the bar


class Band(NamedTuple):
    """A named and shaded interval of a histogram's axis."""

    low: float
    high: float
    name: str


def trend(label: str, lines: Sequence[Line], limits: Sequence[float], step: str) -> str:
    """Draws a line chart over numbered steps, with limits as dashed horizontal lines; returns HTML.

    Args:
        label: description for screen readers.
        lines: the lines, each with its values from the first step on.
        limits: values of the limits.
        step: what a step is, such as "squeeze"; a label of the axis.
    """
    values = [value for line in lines for value in line.values]
    if not values:
        return "<p>Nothing was measured.</p>"
    low, high = min(0.0, *values, *limits), max(0.0, *values, *limits)
    count = max(len(line.values) for line in lines)
    across, up = 100.0 / max(count - 1, 1), 100.0 / ((high - low) or 1.0)

    def place(index: float, value: float) -> str:
        return f"{index * across:.2f},{100.0 - (value - low) * up:.2f}"

    drawn = []
    for value, kind in ((0.0, "zero"), *((limit, "limit") for limit in limits)):
        ends = f"{place(0, value)} {place(max(count - 1, 1), value)}"
        drawn.append(f'<polyline class="{kind}" points="{ends}"/>')
    for number, line in enumerate(lines):
        points = " ".join(place(index, value) for index, value in thinned(line.values))
        drawn.append(f'<polyline class="line s{number}" points="{points}"/>')
    names = [f'<span class="s{n}">{escape(line.name)}</span>' for n, line in enumerate(lines)]
    names += ['<span class="limit">limit</span>'] * bool(limits)
    above = f'<p class="names">{" ".join(names)}</p>' if len(names) > 1 else ""
    axis = f"<span>{low:.3g}</span><span>{escape(step)} {count}</span>"
    return _chart(label, drawn, above=f'{above}<p class="axis">{high:.3g}</p>', axis=axis)


def bars(label: str, rows: Sequence[Bar]) -> str:
    """Draws a bar chart; returns HTML. The bar of the largest amount has the full width.

    Args:
        label: caption of the chart.
        rows: the bars, from the top down.
    """
    most = max((row.amount for row in rows), default=0.0) or 1.0
    lines = (
        f'<tr><th scope="row">{escape(row.name)}</th><td>{escape(row.text)}</td><td class="amount">'
        f'<svg viewBox="0 0 100 1" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect class="s0" width="{100.0 * row.amount / most:.1f}" height="1"/></svg></td></tr>'
        for row in rows
    )
    return f'<table class="bars"><caption>{escape(label)}</caption>{"".join(lines)}</table>'


def histogram(
    label: str,
    counts: Sequence[tuple[float, float]],
    bands: Sequence[Band],
    span: tuple[float, float],
    unit: str,
) -> str:
    """Draws a histogram of values over shaded intervals of the axis; returns HTML.

    Args:
        label: description for screen readers.
        counts: pairs of a value and its count; the drawn height is the square root of the count.
        bands: the shaded intervals; a name for which there is no room is left out.
        span: the lowest and the highest value of the axis.
        unit: unit of the values.
    """
    low, high = span
    scale = 100.0 / ((high - low) or 1.0)
    most = max((number for _, number in counts), default=0.0) or 1.0
    drawn = [
        f'<rect class="band s{k % 6}" x="{(band.low - low) * scale:.2f}" y="0" height="100" '
        f'width="{max(band.high - band.low, 0.0) * scale:.2f}"/>'
        for k, band in enumerate(bands)
    ]
    stems = "".join(
        f"M{(value - low) * scale:.1f} 100V{100.0 - 92.0 * (number / most) ** 0.5:.0f}"
        for value, number in counts
    )
    drawn.append(f'<path class="stem" d="{stems}"/>')
    names = (
        f'<span style="left:{at:.1f}%">{escape(name)}</span>' for at, name in _apart(bands, span)
    )
    axis = f"<span>{low:.3g} {unit}</span><span>{high:.3g} {unit}</span>"
    return _chart(label, drawn, above=f'<p class="bands">{"".join(names)}</p>', axis=axis)


def thinned(values: Sequence[float]) -> list[tuple[int, float]]:
    """Reduces a line to at most `MOST_POINTS` points for drawing.

    Returns:
        Pairs of an index and a value: of each group of consecutive values, the value farthest from zero.
    """
    stretch = max(1, -(-len(values) // MOST_POINTS))
    points = list(enumerate(values))
    stretches = (points[k : k + stretch] for k in range(0, len(points), stretch))
    return [max(each, key=lambda point: abs(point[1])) for each in stretches]


def _apart(bands: Sequence[Band], span: tuple[float, float]) -> list[tuple[float, str]]:
    """Places the names of bands below a histogram's axis; leaves out names that would overlap.

    Returns:
        Pairs of a position (percent of the span) and a name.
    """
    shown: list[tuple[float, str]] = []
    low, high = span
    for band in sorted(bands):
        at = 100.0 * (0.5 * (band.low + band.high) - low) / ((high - low) or 1.0)
        if not shown or at - shown[-1][0] >= APART:
            shown.append((at, band.name))
    return shown


def _chart(label: str, drawn: Sequence[str], above: str, axis: str) -> str:
    head = f'<div class="chart" role="img" aria-label="{escape(label)}">{above}'
    plot = '<svg viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true">'
    return f'{head}{plot}{"".join(drawn)}</svg><p class="axis">{axis}</p></div>'
