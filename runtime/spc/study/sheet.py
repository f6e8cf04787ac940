"""Shows the study of a run-off: as an HTML page to print on two sheets, and as lines for a terminal."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from runtime import VERSION
from runtime.pages import frame
from runtime.pages.charts import Line
from runtime.spc.page import picture
from runtime.spc.study.acceptance import ERROR, Verdict
from runtime.spc.study.figures import GaugeRow, Study, in_degrees
from runtime.spc.study.gauge import ACCEPTABLE, CAPABLE, GOOD, LEAST_READINGS, Crossed, TypeOne
from runtime.spc.summary import Series

MOST_LEAVES = 16  # leaves on the sheet, those with the most parts; --json has all
MOST_JOURNALS = 6
MOST_CAPABLE = 100.0  # largest Cg or Cgk that is written out
UNITS = {
    "x_mm": ("x", "mm"),
    "y_mm": ("y", "mm"),
    "theta_rad": ("angle", "deg"),
    "width_mm": ("width", "mm"),
}
MEANING = (
    f"Bias: what the leaf says less what was measured. A gauge is capable from Cg and Cgk {CAPABLE} on; "
    f"below {LEAST_READINGS} readings nothing is said of it. The measurement's own scatter counts, too."
)
SIGNED = ("supplier", "customer")


def page(study: Study, journals: Sequence[str]) -> str:
    """Returns the run-off sheet as an HTML page.

    Args:
        study: the study that the sheet shows.
        journals: names of the files of the journals that were studied.
    """
    grades = {Verdict.ACCEPTED: "good", Verdict.OPEN: "fair"}
    grade = grades.get(study.acceptance.verdict, "poor")
    heads = ("leaf", "readings", *_heads(study.table))
    signatures = ((who, "", "", "") for who in SIGNED)
    body = [
        "<header><h1>Run-off sheet</h1>",
        frame.verdict(grade, f"{verdict_words(study).capitalize()}."),
        "</header>\n<main>",
        frame.table("Facts", ("what", "value"), _facts(study, journals), "wide facts"),
        *picture(_curve(study)),
        '<h2 class="next">The squeeze as a gauge of poses</h2>',
        f"<p>{escape(MEANING)}</p>",
        frame.table("Leaves as gauges", heads, map(_gauge_cells, _shown(study))),
        *_left_out(study),
        *_crossed(study.crossed),
        "<h2>Signatures</h2>",
        frame.table("Signatures", ("who", "name", "date", "signature"), signatures, "signatures"),
        "</main>",
    ]
    return frame.page("Run-off sheet", "\n".join(body), kind="sheet")


def verdict_words(study: Study) -> str:
    """Returns the verdict of the acceptance as a line for a terminal, with the counts behind it."""
    now, bounds = study.acceptance, study.bounds
    required = f"{1.0 - now.limit:.6g} of all parts located"
    shown = f"{now.failed} of {now.parts} failed"
    shown += f" and {now.unknown} are not known" if now.unknown else ""
    interval = f"failures {bounds.low:.4%} to {bounds.high:.4%} with {1.0 - ERROR:.0%} confidence at any look"
    if now.verdict is Verdict.OPEN:
        more = max(study.planned.likely or 0, study.planned.least or 0)
        planned = f"{more or 'too many'} parts in all were planned"
        return f"not decided yet: {required} is asked for; {shown}; {interval}; {planned}"
    decided = f"{now.verdict} after {now.decided_at} parts"
    return f"{decided}: {required} was asked for; {shown}; {interval}"


def gauge_words(study: Study) -> Iterator[str]:
    """Yields lines for a terminal: the type-1 studies of all leaves together, then those of each leaf."""
    for row in (study.table, *study.leaves):
        name = "table" if row.leaf is None else f"leaf {row.leaf}"
        figures = "; ".join(_type_one_words(key, one) for key, one in row.studies.items())
        few = "" if row.readings >= LEAST_READINGS else f" (too few: {LEAST_READINGS})"
        yield f"type 1   {name}, {row.readings} readings{few}: {figures or 'the goal has no tolerance'}"


def crossed_words(studies: Mapping[str, Crossed]) -> Iterator[str]:
    """Yields one line for a terminal for each crossed study; `studies` holds the studies by quantity."""
    for name, study in studies.items():
        word = UNITS.get(name, (name, ""))[0]
        percent, ndc = _figure(study.percent), _known(study.anova.fields()["ndc"])
        line = f"R&R      {word}: %GRR {percent} ({judged(study)}), ndc {ndc}"
        if study.ranges is not None:
            ranges = _figure(study.ranges.percent(study.ranges.gauge))
            line += f"; by average and range {ranges}"
        yield f"{line}; {study.parts} parts, {study.appraisers} appraisers, {study.trials} trials"


def judged(study: Crossed) -> str:
    """Judges the %GRR of a crossed study by AIAG's limits, in words."""
    if study.percent is None:
        return "not known: nothing varied"
    if study.percent <= GOOD:
        return "good"
    return "may do" if study.percent <= ACCEPTABLE else "not acceptable"


def _facts(study: Study, journals: Sequence[str]) -> Iterator[tuple[str, str]]:
    history, table = study.history, study.history.table
    more = f" and {len(journals) - MOST_JOURNALS} more" if len(journals) > MOST_JOURNALS else ""
    times = [part.time[:19] for part in history.parts if part.time]
    outcomes = Counter(part.outcome for part in history.parts)
    yield "journals", ", ".join(journals[:MOST_JOURNALS]) + more
    yield "parts", f"{times[0]} to {times[-1]} UTC" if times else "undated"
    yield "outcomes", ", ".join(f"{count} {name}" for name, count in sorted(outcomes.items()))
    yield "table, SHA-256", history.table_sha256
    yield "job, SHA-256", table.job_digest.hex()
    yield "compiled by, sheet by", f"{table.tool}, squeezetree {VERSION}"
    yield "gripper", table.gripper.model
    if any(part.true is not None for part in history.parts):
        yield "cell", "simulated: the journals hold the true poses of parts"
    likely = "not known" if study.planned.likely is None else str(study.planned.likely)
    least = "too many" if study.planned.least is None else str(study.planned.least)
    yield "parts that were needed", f"{least} without a failure; planned {likely}"


def _curve(study: Study) -> Series:
    course = [(now.bounds, now.parts) for now in study.curve]
    most = 8.0 * study.acceptance.limit  # the first parts have little information
    lines = (
        Line("at most", [min(bounds.high, most) for bounds, _ in course]),
        Line("failures", [min(bounds.share, most) for bounds, _ in course]),
        Line("at least", [min(bounds.low, most) for bounds, _ in course]),
    )
    limits, step = (study.acceptance.limit,), f"{study.acceptance.parts} parts, look"
    method = "The limit is the share that was agreed on."
    return Series("Share of failures, with its bounds at each look", lines, limits, step, method)


def _shown(study: Study) -> list[GaugeRow]:
    most = sorted(study.leaves, key=lambda row: -row.readings)[:MOST_LEAVES]
    return [study.table, *sorted(most, key=lambda row: row.leaf or 0)]


def _left_out(study: Study) -> Iterator[str]:
    more = len(study.leaves) - MOST_LEAVES
    if more > 0:
        yield f"<p>{more} leaves with fewer readings are left out; --json has them.</p>"


def _heads(row: GaugeRow) -> Iterator[str]:
    for name in row.studies:
        word, unit = UNITS[name]
        yield from (f"{word}: bias {unit}", "Cg", "Cgk")


def _gauge_cells(row: GaugeRow) -> Iterator[str]:
    yield from ("all" if row.leaf is None else str(row.leaf), str(row.readings))
    for name, one in row.studies.items():
        enough = one.readings >= LEAST_READINGS
        yield f"{in_degrees(name, one.bias):+.3f}"
        yield from (_capability(value) if enough else "" for value in (one.cg, one.cgk))


def _type_one_words(name: str, one: TypeOne) -> str:
    word, unit = UNITS[name]
    bias = f"{in_degrees(name, one.bias):+.3f} {unit}"
    return f"{word} bias {bias}, Cg {_capability(one.cg)}, Cgk {_capability(one.cgk)}"


def _crossed(studies: Mapping[str, Crossed]) -> Iterator[str]:
    if not studies:
        return
    yield "<h2>Gauge R&amp;R, crossed, analysis of variance</h2>"
    heads = ("quantity", "EV", "AV", "GRR", "PV", "%GRR", "ndc", "judged")
    rows = (_crossed_cells(name, study) for name, study in studies.items())
    yield frame.table("Gauge R&R", heads, rows)


def _crossed_cells(name: str, study: Crossed) -> Iterator[str]:
    word, unit = UNITS[name]
    spread = study.anova
    yield f"{word} {unit}"
    for value in (spread.repeatability, spread.reproducibility, spread.gauge, spread.part):
        yield f"{in_degrees(name, value):.4g}"
    yield from (_figure(study.percent), _known(spread.fields()["ndc"]), judged(study))


def _capability(value: float | None) -> str:
    """Writes a Cg or Cgk as text: values above `MOST_CAPABLE` as "over ...", None as "not known".

    Such large values, as in a simulated cell, only mean that there is almost no scatter.
    """
    return f"over {MOST_CAPABLE:g}" if value and value > MOST_CAPABLE else _figure(value)


def _figure(value: float | None) -> str:
    return "not known" if value is None else f"{value:.2f}"


def _known(value: object) -> str:
    return "not known" if value is None else str(value)
