"""plan-try: a first answer from a drawing within a minute, and the files to continue with."""

import argparse
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from planner.cli import course, first_plan, shell
from planner.cli.gripper_comparison import ALL, compare
from planner.compile import Plan, load_kernels
from planner.diagnosis.advice import advise
from planner.diagnosis.alike import alike
from planner.errors import FitError, NoPlanError
from planner.evaluation.evaluate import Line
from planner.job import model as job_file
from planner.job.drafts import FINGERS, GRIPPERS, draft
from planner.job.model import Job
from planner.part.importers.file import SUFFIXES
from planner.part.outline import smallest_rectangle
from planner.problem import Problem
from planner.report import canvas, look, paper_figures
from planner.report.answer import QUESTION, Answer
from planner.report.replay import replay
from planner.report.verdict import Grade, verdict, weakest
from planner.report.worlds import affordable, seconds_a_part, tried, untried
from planner.work.limit import Limit
from planner.work.progress import Report
from planner.work.scheduler import Threads
from runtime.shell.command import Parser, number, positive, say
from runtime.shell.command import seconds as seconds_text
from runtime.shell.errors import UsageError
from runtime.shell.files import fitting, quoted, usable, write
from runtime.table import TableError, dump, load

ANSWER_S = 60.0  # time until the last line, including the compilation of kernels
LEAST_ANSWER_S = 12.0  # least time for the answer after the kernels are compiled
PICTURE_S = 3.0
LEAST_DRAWN = 300  # least number of parts in the picture, even if it takes longer than `PICTURE_S`
WORTH_TELLING = 0.005  # share of unfinished parts from which the answer mentions them
LEAST_DONE = 0.9  # least share located among the finished parts for the answer "cut"
MOST_OPEN = 0.5  # share of unfinished parts above which the answer is "unknown"
LOCATABLE = {"good": True, "fair": True, "cut": True, "poor": False, "unknown": None}

Spared = Callable[[str], AbstractContextManager[None]]
"""Takes the name of optional work; returns a context in which its failure does not prevent the answer."""


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        first_plan.NAME,
        "Can this part be located by squeezing, and how well? Plans for a minute, asks nothing, says what it "
        "assumed, and writes a job file, a table and a picture to go on with.",
        f"{first_plan.NAME} part.dxf --units mm",
        f"{first_plan.NAME} part.svg --units mm --gripper hand-e --radius 5 -o first/part.toml",
    )
    built.add_argument("drawing", type=Path, help=f"drawing of the part: {', '.join(SUFFIXES)}")
    text = (
        "the job file; table and picture go beside it (default: in this folder, named after the "
        "drawing, with a number if another job has the name)"
    )
    shell.add_output(built, "JOB.toml", text, required=False)
    shell.add_drawing(built.add_argument_group("the drawing"))
    stated = built.add_argument_group("in place of defaults")
    add = stated.add_argument
    text = "the part's centre lies in a disc of this radius"
    add("--radius", type=number, metavar="MM", help=text)
    text = f"the part is turned by at most this, either way (default: {first_plan.TURN_DEG:g})"
    add("--turn", type=number, metavar="DEG", help=text)
    text = (
        f"model of the gripper (default: the first that opens wide enough); {ALL}: compare all in one table, "
        "each planned for --budget (default: half a minute), and write nothing"
    )
    add("--gripper", choices=[*GRIPPERS, ALL], help=text)
    add("--fingers", choices=FINGERS, help="material of the finger pads (default: rubber)")
    shell.add_distance(stated)
    text = "height of the part (default: that of a solid; unknown for an outline)"
    add("--thickness", type=positive, metavar="MM", help=text)
    text = "time for the answer, once kernels are loaded (default: a minute)"
    add("--budget", type=seconds_text, metavar="30s", help=text)
    text = "print progress as JSON, one object a line, on standard error"
    built.add_argument("--follow", action="store_true", help=text)
    return built


class Files(NamedTuple):
    """Paths of the job file, the table and the picture that the command writes."""

    job: Path
    table: Path
    picture: Path


def _try(arguments: argparse.Namespace) -> None:
    if arguments.gripper == ALL:
        compare(arguments)
        return
    started = time.monotonic()
    if arguments.output is not None:
        fitting(usable(arguments.output, arguments.drawing), "a job file", ".toml")
    imported, notes = first_plan.imported_of(arguments)
    setting = first_plan.setting_of(arguments, imported)
    answers, rectangle = setting.answers, smallest_rectangle(imported.outline_mm)
    figures: dict[str, Any] = {
        "part": answers.name,
        "size_mm": [rectangle.length_mm, rectangle.width_mm],
        "turn_deg": rectangle.turn_deg,
        "assumed": [*notes, *setting.assumed],
    }
    show = shell.printer(arguments.json)
    show(f"{answers.name}: {rectangle.text()}, {len(imported.outline_mm)} vertices")
    if not arguments.json:
        for line in figures["assumed"]:
            say(f"assumed: {line}")
    failures: list[str] = []
    spared = partial(shell.spared, notes=failures, debug=arguments.debug)
    try:
        first_plan.check_thickness(imported)
        text = draft(imported, arguments.drawing.name, answers)
        files = _files(arguments, text)
        write(files.job, text)
        figures["job"] = str(files.job)
        job = job_file.load(files.job)
        figures["alike"] = [result.line() for result in alike(job)]
        show("".join(f"note: {line}\n" for line in figures["alike"]), end="", flush=True)
        with first_plan.progress_of(arguments, course.unknown) as report, shell.compiling():
            report("kernels", 0, 1)
            load_kernels(Problem.of(job))
        ready = time.monotonic()
        answer_s = arguments.budget or max(LEAST_ANSWER_S, ANSWER_S - (ready - started))
        with first_plan.progress_of(arguments, course.of_time(answer_s)) as report:
            plan = first_plan.planned_within(job, answer_s, arguments.budget is None, report)
            dump(plan.table, files.table)
            part_s = seconds_a_part(plan.table, job, Threads())
            left_s = ready + answer_s - PICTURE_S - time.monotonic()
            trials, limit = affordable(job, left_s, part_s), Limit(left_s)
            answer = _answered(job, plan, setting.restrictions, trials, limit, spared, report)
    except (FitError, NoPlanError) as error:
        known = not getattr(error, "cut_short", False)
        reason = {"locatable": False if known else None, "verdict": "poor" if known else "unknown"}
        short = f"No: {error}." if known else f"Not known: {error}; give it a longer --budget."
        refused = {**figures, **reason, "answer": short, "reason": str(error)}
        shell.answer(arguments.json, refused, "", f"{QUESTION} {short}")
        return
    show("\n".join(["", *answer.lines()]), flush=True)
    picture: Path | None = None
    with spared("picture"):
        drawn = min(first_plan.TRIALS, max(LEAST_DRAWN, int(PICTURE_S / part_s)))
        beliefs = replay(plan.table, job, drawn, plan.seed)
        shown = plan.table, job, beliefs, look.SQUEEZES, imported.holes_mm
        canvas.save(files.picture, lambda: paper_figures.sequence(*shown))
        picture = files.picture
    seconds = time.monotonic() - started
    figures |= {
        "locatable": LOCATABLE[answer.short],
        "verdict": answer.short,
        "answer": answer.short_text(),
        "sentence": answer.verdict.sentence,
        "restrictions": setting.restrictions,
        "conditions": answer.verdict.conditions,
        "warnings": answer.verdict.warnings,
        **answer.figures,
        "weakest": answer.worst and answer.worst._asdict(),
        "limits": answer.limits,
        "cut_short": plan.cut and plan.cut.figures(),
        "table": str(files.table),
        "picture": picture and str(picture),
        "notes": failures,
        "seconds": round(seconds, 1),
    }
    after = [f"note       {line}" for line in failures]
    shell.answer(arguments.json, figures, *after, *_next(files, picture, plan, seconds))


def _answered(
    job: Job,
    plan: Plan,
    restrictions: list[str],
    trials: int,
    limit: Limit,
    spared: Spared,
    report: Report,
) -> Answer:
    """The answer for a plan: its figures, its weakest assumption in other worlds, and what limits it.

    Each of the other worlds is tried with `trials` parts. Once the time of `limit` is over, no further world
    is tried.
    """
    figures, lines, limits = plan.evaluation.summary(), list[Line](), list[str]()
    with spared("other worlds"):
        lines = tried(plan.table, job, plan.evaluation, trials, Threads(), report, limit)
    open_share = plan.cut.open_share if plan.cut else 0.0
    if plan.cut and open_share >= WORTH_TELLING:
        limits = [plan.cut.line()]
    elif figures["success_rate"] < 1.0:
        with spared("advice"):
            limits = advise(plan.table, plan.evaluation, job).lines()
    left_out = untried(job, lines) if lines else []
    if left_out:
        limits.append(f"the budget left no time to try: {'; '.join(left_out)}")
    result = verdict(job, figures, lines, left_out)
    short = _short(result.grade, figures["success_rate"], open_share)
    most, worst, confidence = plan.table.limits.max_depth, weakest(lines), job.goal.confidence
    return Answer(short, result, figures, most, worst, limits, restrictions, confidence)


def _short(grade: Grade, success: float, open_share: float) -> str:
    """Returns the grade of a plan; a poor plan of an unfinished search may get "unknown" or "cut" instead.

    `open_share` is the share of parts for which the search is unfinished. A poor plan gets "unknown" if this
    share is above `MOST_OPEN`. Otherwise it gets "cut" if the plan locates at least the share `LEAST_DONE` of
    the parts for which the search is finished.
    """
    if grade != "poor" or not open_share:
        return grade
    if open_share > MOST_OPEN:
        return "unknown"
    return grade if success < LEAST_DONE * (1.0 - open_share) else "cut"


def _files(arguments: argparse.Namespace, text: str) -> Files:
    """Chooses the paths of the files to write.

    `--output` names the job file. Without this option, the job file is the first free one of NAME.toml,
    NAME-2.toml and so on, with the name of the drawing. The files of an earlier answer for the same job are
    overwritten, and no others.

    Raises:
        UsageError: `--output` names a file that exists, or would overwrite a table or picture beside it.
        OutputError: a file cannot be written.
    """
    stem, number = arguments.drawing.stem, 1
    files = _beside(arguments.output or Path(f"{stem}.toml"))
    while taken := _taken(files, text):
        if arguments.output is not None:
            raise UsageError(f"{taken} is there already; name another file")
        number += 1
        files = _beside(Path(f"{stem}-{number}.toml"))
    for path in files:
        usable(path, arguments.drawing)
    return files


def _beside(job: Path) -> Files:
    return Files(job, job.with_suffix(".msgpack"), job.with_suffix(".look.svg"))


def _taken(files: Files, text: str) -> Path | None:
    """The first of the files that exists and is not of an earlier answer for the job `text`; None: none."""
    if not files.job.exists():
        return next((path for path in files if path.exists()), None)
    if not files.job.is_file() or files.job.read_bytes() != text.encode():
        return files.job
    return files.table if files.table.exists() and not _is_quick(files.table, text) else None


def _is_quick(table: Path, text: str) -> bool:
    """Whether a file is a table of a first answer for the job `text`; it may be one of a full search."""
    try:
        planned = load(table).table.job
    except TableError:
        return False
    return planned == job_file.parse(text).replaced(search=first_plan.QUICK).canonical()


def _next(files: Files, picture: Path | None, plan: Plan, seconds: float) -> list[str]:
    """Lines that name the files written and the next commands."""
    longer = " (a full search)" if plan.cut else ""
    written = [files.job, files.table, *filter(None, (picture,))]
    job, table, report = map(quoted, (files.job, files.table, files.job.with_suffix(".html")))
    return [
        "",
        f"wrote {', '.join(map(str, written[:-1]))} and {written[-1]} after {seconds:.0f} s",
        *([f"look       {picture}"] if picture else []),
        f"plan       squeezetree plan {job} -o {table}{longer}",
        f"report     squeezetree report {table} -o {report}",
        f"simulate   squeezetree run --tree {table} --port sim --time-scale 100 --count 20",
    ]


main = shell.main_of(parser, _try)
