"""`grasp-audit study`: accepts or refuses a cell by its journals, or plans the number of parts for that."""

import argparse
import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from runtime.shell.command import Parser, named_path, number, positive_int, run, say_result
from runtime.shell.errors import InputError, UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import fitting, usable, write
from runtime.spc.history import read
from runtime.spc.study import figures
from runtime.spc.study.acceptance import ERROR, POWER, Planned, Verdict, planned
from runtime.spc.study.gauge import ACCEPTABLE, LEAST_READINGS, Crossed, crossed
from runtime.spc.study.sheet import crossed_words, gauge_words, page, verdict_words
from runtime.table import PPM, load

EPILOG = """\
examples:
  grasp-audit study --plan T.msgpack
  grasp-audit study run-off.jsonl -o run-off.html
  grasp-audit study monday.jsonl tuesday.jsonl wednesday.jsonl --crossed 10
  grasp-audit study --measurements gauge.csv

""" + epilog(ExitCode.INPUT, ExitCode.CHECK_FAILED, ExitCode.UNDECIDED, ExitCode.JOURNAL)
COLUMNS = ("part", "appraiser", "value")
MOST_ROWS = 100_000
MOST_VALUE = 1e12  # largest magnitude of a reading


def parser() -> Parser:
    """Builds the argument parser of `grasp-audit study`."""
    text = "Accept a cell by its audited parts, checked at any time; study the squeeze as a gauge."
    built = Parser(prog="grasp-audit study", description=text, epilog=EPILOG)
    add = built.add_argument
    text = "journals of audited runs of one table, in the order of the runs"
    add("journals", type=named_path, nargs="*", metavar="JOURNAL", help=text)
    text = "the run-off sheet, to print on two pages"
    add("-o", "--output", type=Path, metavar="F.html", help=text)
    text = (
        "share of parts to be located within the goal (default: the confidence of the table's goal)"
    )
    add("--required", type=_share, metavar="SHARE", help=text)
    text = "gauge R&R: each journal is an appraiser who measures the same PARTS parts, always in one order"
    add("--crossed", type=positive_int, metavar="PARTS", help=text)
    text = "judge a simulated cell's parts by where they were, not by audits"
    add("--truth", action="store_true", help=text)
    text = "instead: how many parts to run for a table, before they are run"
    add("--plan", type=Path, metavar="T", help=text)
    text = f"instead: gauge R&R of a table with the columns {', '.join(COLUMNS)}, a row a reading"
    add("--measurements", type=Path, metavar="F.csv", help=text)
    built.add_common()
    return built


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    return run(parser(), arguments, _study)


def _study(options: argparse.Namespace) -> int:
    asked = [bool(options.journals), options.plan is not None, options.measurements is not None]
    if sum(asked) != 1:
        raise UsageError("name journals, or a table with --plan, or a file with --measurements")
    if not options.journals and (options.crossed or options.truth or options.output):
        raise UsageError(
            "--crossed, --truth and --output need journals; name some, or leave these options out"
        )
    if options.plan is not None:
        return _plan(options)
    return _of_measurements(options) if options.measurements is not None else _of_journals(options)


def _of_journals(options: argparse.Namespace) -> int:
    if options.output is not None:
        fitting(usable(options.output, *options.journals), "a page for a browser", ".html")
    history = read(options.journals)
    if options.truth:
        history = figures.by_truth(history)
    others: Mapping[str, Crossed] = {}
    if options.crossed is not None:
        others = figures.crossed_of([read([path]) for path in options.journals], options.crossed)
    if others and options.output is None and not any(part.verdict for part in history.parts):
        return _say_crossed(options, others)  # crossed studies need no audit
    study = figures.studied(history, _limit(options, history.table.goal.confidence_ppm), others)
    if options.output is not None:
        write(options.output, page(study, [path.name for path in options.journals]))
    lines = (verdict_words(study), *gauge_words(study), *crossed_words(study.crossed))
    say_result(options.json, study.fields(), lines)
    verdict = study.acceptance.verdict
    codes = {Verdict.REFUSED: ExitCode.CHECK_FAILED, Verdict.OPEN: ExitCode.UNDECIDED}
    return 0 if verdict is Verdict.ACCEPTED else codes[verdict]


def _plan(options: argparse.Namespace) -> int:
    table = load(options.plan).table
    limit = _limit(options, table.goal.confidence_ppm)
    expected, leaves = figures.expected_failures(table), figures.parts_of_leaves(table)
    count = planned(limit, expected)
    plan = {
        "required": 1.0 - limit,
        "expected_failures": expected,
        "confidence": 1.0 - ERROR,
        "parts_least": count.least,
        "parts_likely": count.likely,
        "parts_type1": leaves,
        "readings_type1": LEAST_READINGS,
        "crossed": figures.CROSSED,
    }
    say_result(options.json, plan, _planned_lines(limit, expected, leaves, count))
    hopeless = count.least is None or (expected is not None and expected >= limit)
    return ExitCode.CHECK_FAILED if hopeless else 0


def _planned_lines(
    limit: float, expected: float | None, leaves: int | None, count: Planned
) -> Iterator[str]:
    shown = f"to show {1.0 - limit:.9g} located"
    if count.least is None:
        yield f"accepted   never: more parts than anybody runs are needed {shown}; state less as --required"
        return
    yield f"accepted   after {count.least} parts without a failure, {shown}"
    if expected is None:
        yield "           the table says nothing of failures to expect: evaluate it (plan-evaluate)"
    elif expected >= limit:
        yield f"           but {expected:.3%} failures are expected: no number of parts would do"
    else:
        likely = "more than anybody runs" if count.likely is None else f"after {count.likely} parts"
        planned_for = f"with probability {POWER:.0%}, of the {expected:.3%} expected to fail"
        yield f"           {likely} {planned_for}"
    if leaves is not None:
        yield f"type 1     {leaves} parts for {LEAST_READINGS} readings at each leaf but the rarest"
    yield "gauge R&R  10 parts, 3 appraisers, 3 trials: 90 parts (AIAG)"


def _of_measurements(options: argparse.Namespace) -> int:
    try:
        study = crossed(_readings(options.measurements))
    except ValueError as error:
        raise InputError(f"{options.measurements}: {error}") from error
    return _say_crossed(options, {"value": study})


def _say_crossed(options: argparse.Namespace, studies: Mapping[str, Crossed]) -> int:
    """Prints crossed studies; returns the exit code.

    Args:
        options: the parsed command line.
        studies: the studies by the name of their quantity.

    Returns:
        0 if each known %GRR is acceptable, CHECK_FAILED if one is not, UNDECIDED if none is known.
    """
    fields = {"crossed": {name: study.fields() for name, study in studies.items()}}
    say_result(options.json, fields, crossed_words(studies))
    known = [study.percent for study in studies.values() if study.percent is not None]
    if not known:
        return ExitCode.UNDECIDED
    return ExitCode.CHECK_FAILED if max(known) > ACCEPTABLE else 0


def _readings(path: Path) -> list[list[list[float]]]:
    """Reads the file of a crossed study; returns its readings by part, appraiser and trial.

    Raises:
        InputError: the file is invalid; the message states the problem and the row.
        OSError: the file cannot be read.
    """
    cells: dict[tuple[str, str], list[float]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file)
            if not set(COLUMNS) <= set(rows.fieldnames or ()):
                raise InputError(f"{path}: write the columns {', '.join(COLUMNS)} in its first row")
            for count, row in enumerate(rows, 2):
                if count > MOST_ROWS:
                    raise InputError(f"{path}: has more than {MOST_ROWS} rows")
                if None in row:
                    remedy = "write decimal points, and a comma between two fields only"
                    raise InputError(
                        f"{path}, row {count}: has more fields than its first row; {remedy}"
                    )
                part, appraiser, text = ((row[name] or "").strip() for name in COLUMNS)
                if abs(value := number(text)) > MOST_VALUE:
                    raise InputError(f"{path}, row {count}: {text} is beyond {MOST_VALUE:g}")
                cells.setdefault((part, appraiser), []).append(value)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is no table of text: {error}") from error
    except argparse.ArgumentTypeError as error:
        raise InputError(f"{path}, row {count}: {error}") from error
    parts, appraisers = (list(dict.fromkeys(key[k] for key in cells)) for k in (0, 1))
    return [[cells.get((part, appraiser), []) for appraiser in appraisers] for part in parts]


def _limit(options: argparse.Namespace, confidence_ppm: int) -> float:
    """Largest acceptable share of failures, from the option --required, else from the table's goal.

    Args:
        options: the parsed command line.
        confidence_ppm: share of parts that the table's goal requires to be located, ppm.

    Raises:
        UsageError: the table's goal requires that all parts are located; no study can prove this.
    """
    limit = 1.0 - options.required if options.required is not None else 1.0 - confidence_ppm / PPM
    if not 0.0 < limit < 1.0:
        raise UsageError(
            "the table's goal asks for all parts, which none can show; state --required"
        )
    return limit


def _share(text: str) -> float:
    value = number(text)
    if not 0.0 < 1.0 - value < 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no share between 0 and 1, e.g. 0.99")
    return value
