"""The report as one HTML page: what to do, key figures, charts and, folded away below them, tables."""

from collections.abc import Iterable, Iterator
from html import escape
from math import degrees

from runtime.pages import charts, frame
from runtime.shell.plain_text import capital
from runtime.spc.monitor import REFIT
from runtime.spc.summary import LeafRow, NodeRow, Series, Summary


def page(title: str, summary: Summary) -> str:
    """Returns the report as one HTML page.

    Args:
        title: title of the page.
        summary: what the page shows.
    """
    ended = [charts.Bar(name, count, str(count)) for name, count in summary.outcomes.items()]
    body = [
        f"<header><h1>{escape(title)}</h1>",
        *_verdict(summary),
        frame.cards(_cards(summary)),
        "</header>\n<main>",
        charts.bars("How parts ended", ended),
        '<div class="charts">',
        *(part for chart in summary.charts for part in picture(chart)),
        "</div>",
        *_names(summary),
        "<h2>In detail</h2>",
        frame.folded("Leaves: how right their answers are", *_leaves(summary.leaves)),
        frame.folded("Nodes: how often parts took each branch", *_nodes(summary)),
        "</main>",
    ]
    return frame.page(title, "\n".join(body))


def picture(chart: Series) -> Iterator[str]:
    """Yields the HTML of a chart: its heading, the drawing and a note; nothing if the chart has no values."""
    if any(line.values for line in chart.lines):
        yield f"<section><h2>{escape(chart.heading)}</h2>"
        yield charts.trend(chart.heading, chart.lines, chart.limits, chart.step)
        yield f'<p class="note">{escape(chart.method)}</p></section>'


def _verdict(summary: Summary) -> Iterator[str]:
    if summary.alarms:
        first = {alarm.chart: alarm for alarm in reversed(summary.alarms)}
        for alarm in sorted(first.values()):
            yield frame.verdict("poor", f"{alarm.sentence}.", f"From part {alarm.place + 1} on:")
        yield f'<p class="note">{len(summary.alarms)} alarms in all; of each chart the first.</p>'
    elif not summary.judged:
        audits = ", ".join(f"{count} {name}" for name, count in summary.verdicts.items())
        why = f"Audits: {audits}; the journals say why." if audits else "Run with --audit to know."
        sentence = f"No alarm, but no part was judged, so how right answers are is open. {why}"
        yield frame.verdict("fair", sentence)
    elif summary.agrees:
        yield frame.verdict("good", "The cell does as its table predicts.")
    else:
        yield frame.verdict("fair", "No alarm, but success is not as predicted.")
    if summary.refit:
        yield f"<p>{escape(capital(REFIT))}.</p>"


def _cards(summary: Summary) -> Iterator[tuple[str, str, str]]:
    total = sum(summary.outcomes.values())
    share = summary.outcomes.get("leaf", 0) / total if total else 0.0
    yield "Parts", str(total), f"{share:.1%} of them located"
    if summary.judged:
        low, high = summary.interval
        counted = f"{summary.passed} of {summary.judged} audited"
        note = f"{counted}; 95 % interval {low:.2%} to {high:.2%}"
        yield "Right answers", f"{summary.passed / summary.judged:.2%}", note
        agreed = "as predicted" if summary.agrees else "not as predicted"
        yield "The table says", f"{summary.predicted:.2%}", f"the cell does {agreed}"


def _names(summary: Summary) -> Iterator[str]:
    if summary.names:
        yield "<h2>Which part it was</h2>"
        rows = ((row.name, str(row.parts), f"{100.0 * row.share:.1f}") for row in summary.names)
        yield frame.table("Parts by name", ("part", "parts", "planned %"), rows)
        yield f'<p class="note">Chi-square against the planned shares: p = {summary.names_tail:.3g}.</p>'


def _leaves(rows: Iterable[LeafRow]) -> Iterator[str]:
    """Yields the HTML of the table of leaves; columns that are empty for all leaves are left out."""
    rows = list(rows)
    columns = {
        "leaf": [str(row.leaf) for row in rows],
        "parts": [str(row.parts) for row in rows],
        "passed": [f"{row.passed} of {row.judged}" if row.judged else "" for row in rows],
        "predicted": ["" if row.predicted is None else f"{row.predicted:.2%}" for row in rows],
    }
    for number, name in enumerate(("x mm", "y mm", "angle deg")):
        columns[name] = [_residual(row, number) for row in rows]
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    if not any(row.residuals for row in rows):
        yield "<p>No pose was measured.</p>"
    else:
        yield '<p class="note">Poses: measured less answered, mean (standard deviation).</p>'
    yield frame.table("Leaves", tuple(shown), zip(*shown.values(), strict=True))


def _residual(row: LeafRow, number: int) -> str:
    if not row.residuals:
        return ""
    mean, sigma = (degrees(v) if number == 2 else v for v in row.residuals[number])
    return f"{mean:+.3f} ({sigma:.3f})"


def _nodes(summary: Summary) -> Iterator[str]:
    reached = sorted((row for row in summary.nodes if sum(row.counts)), key=lambda row: row.tail)
    yield (
        f'<p class="note">The least likely first. Over all nodes p = {summary.tail:.3g} by chi-square: the '
        "probability of counts so far from the table's where nothing has changed.</p>"
    )
    heads = ("node", "squeezes", "p", "rejects", "parts on each branch (predicted)")
    yield frame.table("Nodes", heads, map(_node, reached))


def _node(row: NodeRow) -> Iterator[str]:
    total = sum(row.counts)
    yield from (str(row.node), str(total), f"{row.tail:.3g}", str(row.counts[-1]))
    pairs = zip(row.counts[:-1], row.shares, strict=True)
    yield ", ".join(f"{seen} ({total * share:.1f})" for seen, share in pairs)
