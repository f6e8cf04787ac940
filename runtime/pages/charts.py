"""Charts as HTML: marks are SVG, which scales with the page; labels are text, which does not."""

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

MOST_POINTS = 1200  # most points that are drawn of a line
APART = 9.0  # least distance of two labels under a histogram, percent of its width


class Line(NamedTuple):
    """A named series of values, one for each step."""

    name: str
    values: Sequence[float]


class Bar(NamedTuple):
    """A named amount with its text."""

    name: str
    amount: float
    text: str


class Band(NamedTuple):
    """A named interval of a histogram's axis."""

    low: float
    high: float
    name: str


def trend(label: str, lines: Sequence[Line], limits: Sequence[float], step: str) -> str:
    """Line chart of series over steps, with limits as dashed lines.

    Args:
        label: description for screen readers.
        lines: the series, from the first step on.
        limits: values of the limits.
        step: name of a step, for the axis.
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
    """Bar chart of amounts; the largest has full width."""
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
    """Histogram of values, drawn over shaded and named intervals of the axis.

    Args:
        label: description for screen readers.
        counts: values and their counts; heights are square roots of the counts.
        bands: the shaded intervals; names without room are left out.
        span: ends of the axis.
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
    """Thins values to `MOST_POINTS` at most, for drawing.

    Returns:
        For each stretch of values, the value farthest from zero, with its index.
    """
    stretch = max(1, -(-len(values) // MOST_POINTS))
    points = list(enumerate(values))
    stretches = (points[k : k + stretch] for k in range(0, len(points), stretch))
    return [max(each, key=lambda point: abs(point[1])) for each in stretches]


def _apart(bands: Sequence[Band], span: tuple[float, float]) -> list[tuple[float, str]]:
    """Returns the position (percent of the span) and name of each band, without names that would overlap."""
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
