"""The report as one HTML page: no script, no network, pictures inline."""

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from math import degrees
from pathlib import Path
from string import Template

from runtime.spc.summary import REFIT, LeafRow, NodeRow, Series, Summary

TEMPLATE = Path(__file__).parent / "report.html"

# Okabe and Ito's palette: told apart whatever one's eyes.
COLOURS = ("#0072B2", "#D55E00", "#009E73")
WIDTH, HEIGHT, LEFT, TOP, EDGE = 760.0, 202.0, 46.0, 26.0, 14.0
MOST_POINTS = 1200  # of a line


def page(title: str, summary: Summary) -> str:
    """The whole page.

    Args:
        title: of the page.
        summary: what it says.
    """
    body = [
        *_verdict(summary),
        *_alarms(summary),
        *([f"<p>{escape(REFIT.capitalize())}.</p>"] * summary.refit),
        *(
            part
            for chart in summary.charts
            for part in (f"<h2>{escape(chart.title)}</h2>", picture(chart))
        ),
        *_names(summary),
        "<h2>Residuals by leaf</h2>",
        table_of(
            ("leaf", "parts", "passed", "predicted", "x mm", "y mm", "theta deg"),
            map(_leaf, summary.leaves),
        ),
        "<h2>Branches against the table</h2>",
        f"<p>Chi-square over all nodes: p = {summary.tail:.3g}.</p>",
        table_of(
            ("node", "taken", "predicted %", "rejects", "chi-square", "p"),
            map(_node, summary.nodes),
        ),
    ]
    return whole(title, body)


def whole(title: str, body: Iterable[str], kind: str = "report") -> str:
    """A page of these pieces of HTML; `kind` is the class of its body."""
    template = Template(TEMPLATE.read_text("utf-8"))
    return template.substitute(title=escape(title), body="\n".join(body), kind=kind)


def picture(chart: Series) -> str:
    """A chart as inline SVG: lines, limits dashed, both ends of the axes named."""
    values = [value for _, line in chart.lines for value in line]
    if not values:
        return "<p>Nothing was measured.</p>"
    low, high = min(0.0, *values, *chart.limits), max(0.0, *values, *chart.limits)
    count = max(len(line) for _, line in chart.lines)
    across, up = (
        (WIDTH - LEFT - EDGE) / max(count - 1, 1),
        (HEIGHT - TOP - EDGE) / ((high - low) or 1.0),
    )

    def place(index: float, value: float) -> str:
        return f"{LEFT + index * across:.1f},{HEIGHT - EDGE - (value - low) * up:.1f}"

    def word(x: float, y: float, text: str, colour: str = "#595959", anchor: str = "end") -> str:
        return f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}" text-anchor="{anchor}">{escape(text)}</text>'

    drawn = [f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT + 20:.0f}" font-size="12" fill="none">']
    for value, dash in ((0.0, ""), *((limit, ' stroke-dasharray="5 4"') for limit in chart.limits)):
        ends = f"{place(0, value)} {place(max(count - 1, 1), value)}"
        drawn.append(f'<polyline points="{ends}" stroke="#a6a6a6"{dash}/>')
    for number, (name, line) in enumerate(chart.lines):
        points = " ".join(place(index, value) for index, value in thinned(line))
        drawn.append(f'<polyline points="{points}" stroke="{COLOURS[number]}" stroke-width="1.3"/>')
        drawn.append(word(LEFT + 80 + 125 * number, 12, name, COLOURS[number]))
    drawn.append(word(LEFT - 5, TOP + 4, f"{high:.3g}"))
    drawn.append(word(LEFT - 5, HEIGHT - EDGE + 4, f"{low:.3g}"))
    drawn.append(word(WIDTH - EDGE, HEIGHT + 14, f"{chart.step} {count}"))
    return "\n".join([*drawn, "</svg>"])


def thinned(values: Sequence[float]) -> list[tuple[int, float]]:
    """Thin values for drawing: of each stretch, index and value of the one farthest from zero."""
    stretch = max(1, -(-len(values) // MOST_POINTS))
    points = list(enumerate(values))
    starts = range(0, len(points), stretch)
    return [
        max(points[start : start + stretch], key=lambda point: abs(point[1])) for start in starts
    ]


def _verdict(summary: Summary) -> Iterator[str]:
    ended = ", ".join(f"{count} {name}" for name, count in summary.outcomes.items())
    yield f"<p>{sum(summary.outcomes.values())} parts: {escape(ended)}.</p>"
    audits = ", ".join(f"{count} {name}" for name, count in summary.verdicts.items())
    if not summary.judged:
        why = (
            f"Audits: {audits}; the journals say why."
            if audits
            else "Run with --audit to learn the rate."
        )
        yield f"<p>No part was judged. {escape(why)}</p>"
        return
    rate, (low, high) = summary.passed / summary.judged, summary.interval
    words = "as predicted" if summary.agrees else "not as predicted"
    yield (
        f"<p>Audits: {escape(audits)}. Success {rate:.4f} (95 %: {low:.4f} to {high:.4f}), predicted "
        f'{summary.predicted:.4f}: <span class="{"good" if summary.agrees else "bad"}">{words}</span>.</p>'
    )


def _alarms(summary: Summary) -> Iterator[str]:
    if not summary.alarms:
        if summary.judged:
            yield '<p class="good">All charts are in control.</p>'
        else:
            yield "<p>No alarm, but no part was judged: this says nothing of how right the answers are.</p>"
        return
    yield f"<h2>Alarms</h2>\n<p>{len(summary.alarms)} in all; the first of each chart:</p>"
    first = {alarm.chart: alarm for alarm in reversed(summary.alarms)}
    for alarm in sorted(first.values()):
        yield f'<p class="bad">Part {alarm.number}: {escape(alarm.sentence)}.</p>'


def table_of(names: Iterable[str], rows: Iterable[Iterable[str]], kind: str = "wide") -> str:
    """A table as HTML, a text a cell; `kind` is the class of what is round it."""
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    lines = ["<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([f'<div class="{kind}"><table>', f"<tr>{head}</tr>", *lines, "</table></div>"])


def _names(summary: Summary) -> Iterator[str]:
    if not summary.names:
        return
    yield "<h2>Which part it was</h2>"
    yield f"<p>Chi-square against the planned shares: p = {summary.names_tail:.3g}.</p>"
    rows = ((row.name, str(row.parts), f"{100.0 * row.share:.1f}") for row in summary.names)
    yield table_of(("part", "parts", "planned %"), rows)


def _leaf(row: LeafRow) -> Iterator[str]:
    passed = f"{row.passed} of {row.judged}" if row.judged else "-"
    predicted = "untried" if row.predicted is None else f"{row.predicted:.4f}"
    yield from (str(row.leaf), str(row.parts), passed, predicted)
    for number in range(3):
        if not row.residuals:
            yield "-"
            continue
        mean, sigma = row.residuals[number]
        mean, sigma = (degrees(mean), degrees(sigma)) if number == 2 else (mean, sigma)
        yield f"{mean:+.3f} ({sigma:.3f})"


def _node(row: NodeRow) -> Iterator[str]:
    yield from (str(row.node), " ".join(map(str, row.counts[:-1])))
    yield " ".join(f"{100.0 * share:.1f}" for share in row.shares)
    yield from (str(row.counts[-1]), f"{row.statistic:.2f} ({row.freedom})", f"{row.tail:.3g}")
