"""`grasp-audit report`: reports the state of a cell from the journals of its runs."""

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from runtime.journal.export import Row, write_rows
from runtime.shell.command import Parser, named_path, run
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import fitting, usable, writing
from runtime.spc import expectation
from runtime.spc.history import RESIDUAL, History, Part, read
from runtime.spc.monitor import REFIT
from runtime.spc.page import page
from runtime.spc.summary import Summary, summarise

EPILOG = """\
example:
  grasp-audit report runs/*.jsonl -o report.html --export parts.csv
  plan-expect T.msgpack -o expected.json && grasp-audit report runs/*.jsonl --expected expected.json

""" + epilog(ExitCode.INPUT, ExitCode.CHECK_FAILED, ExitCode.JOURNAL)
COLUMNS = ("index", "part", "time", "outcome", "leaf", "verdict", "squeezes", *RESIDUAL, "alarms")


def parser() -> Parser:
    """Builds the argument parser of `grasp-audit report`."""
    text = "Success, residuals and control charts, from journals alone."
    built = Parser(prog="grasp-audit report", description=text, epilog=EPILOG)
    add = built.add_argument
    text = "journals of one table, in the order of the runs"
    add("journals", type=named_path, nargs="+", metavar="JOURNAL", help=text)
    add("-o", "--output", type=Path, metavar="F.html", help="write the report as this page")
    text = "expected readings from plan-expect, by which a change of friction is detected early"
    add("--expected", type=Path, metavar="F", help=text)
    add("--export", type=Path, metavar="F", help="write a row for each part to this .csv file")
    built.add_common()
    return built


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    return run(parser(), arguments, _report)


def _report(options: argparse.Namespace) -> int:
    inputs = (*options.journals, options.expected)
    for output, other in ((options.output, None), (options.export, options.output)):
        if output is not None:
            usable(output, *inputs, other)
    if options.output is not None:
        fitting(options.output, "a page for a browser", ".html")
    history = read(options.journals)
    expected = None if options.expected is None else expectation.load(options.expected)
    summary = summarise(history, expected)
    _write(options, history, summary)
    print(json.dumps(summary.fields()) if options.json else "\n".join(_lines(summary)))
    return ExitCode.CHECK_FAILED if summary.alarms else 0


def _write(options: argparse.Namespace, history: History, summary: Summary) -> None:
    if options.export is not None:
        alarms: dict[int, list[str]] = {}
        for alarm in summary.alarms:
            alarms.setdefault(alarm.place, []).append(alarm.chart)
        write_rows(rows(history.parts, alarms), options.export, "--export", COLUMNS)
    if options.output is not None:
        first = history.parts[0].time[:10]
        title = f"Audit of {len(history.parts)} parts{f' since {first}' if first else ''}"
        with writing(options.output) as draft:
            draft.write_text(page(title, summary), encoding="utf-8")


def rows(parts: Iterable[Part], alarms: Mapping[int, Sequence[str]]) -> Iterator[Row]:
    """Yields one row of the exported file for each part; unknown values are None.

    Args:
        parts: the parts, in order.
        alarms: names of the charts that alarmed at a part, by the part's index.
    """
    for index, part in enumerate(parts):
        ends = (part.number, part.time, part.outcome, part.leaf, part.verdict, len(part.squeezes))
        residual = part.residual or (None, None, None)
        values = (index, *ends, *residual, " ".join(alarms.get(index, ())))
        yield dict(zip(COLUMNS, values, strict=True))


def _lines(summary: Summary) -> Iterator[str]:
    yield f"parts     {_listed(summary.outcomes)}"
    if summary.verdicts:
        yield f"audits    {_listed(summary.verdicts)}"
    if summary.judged:
        low, high = summary.interval
        share = f"{summary.passed / summary.judged:.4f} (95 %: {low:.4f} to {high:.4f})"
        yield f"success   {share}, predicted {summary.predicted:.4f}"
    if summary.names:
        shares = [f"{row.parts} {row.name} ({row.share:.1%} planned)" for row in summary.names]
        yield f"names     {', '.join(shares)}; p = {summary.names_tail:.3g}"
    yield f"branches  p = {summary.tail:.3g} against the table"
    if summary.refit:
        yield f"advice    {REFIT}"
    for alarm in summary.alarms:
        yield f"ALARM     part {alarm.place + 1}: {alarm.sentence}"
    if not summary.alarms:
        yield "charts    in control"


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items())
