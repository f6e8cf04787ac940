"""plan-try: from a drawing to a first answer in a minute, and the files to go on with."""

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from planner.cli import course, shell
from planner.compile import Plan, compile_job
from planner.diagnosis.advice import advise
from planner.diagnosis.alike import alike
from planner.errors import FitError, NoPlanError, UnitsMissingError
from planner.evaluation.evaluate import Line
from planner.job import model as job_file
from planner.job.drafts import (
    FINGERS,
    GRIPPERS,
    MOST_RADIUS_MM,
    Answers,
    draft,
    proposed_radius_mm,
    room_mm,
)
from planner.job.model import Job
from planner.part.importers.file import SUFFIXES, Imported, read_outline
from planner.part.importers.pieces import Options
from planner.part.outline import smallest_rectangle
from planner.part.tips import MARGIN_MM, tips_height_mm
from planner.report import canvas, paper_figures
from planner.report.answer import QUESTION, Answer
from planner.report.replay import replay
from planner.report.verdict import Grade, verdict, weakest
from planner.report.worlds import affordable, seconds_a_part, tried
from planner.work.limit import Limit
from planner.work.progress import Report
from planner.work.scheduler import Threads
from planner.world import make
from runtime.shell.command import Parser, number, positive, say
from runtime.shell.command import seconds as seconds_text
from runtime.shell.errors import UsageError
from runtime.shell.files import quoted, usable, write
from runtime.table import dump

NAME = "plan-try"
ANSWER_S = 60.0  # from the start to the last line, once kernels are compiled
REST_S, REST = 15.0, 0.3  # of it, what other worlds, advice and picture take at most: time, share
LEAST_ANSWER_S = 12.0  # where compiling kernels took the rest
PICTURE_S = 3.0
LEAST_DRAWN = 300  # parts that the picture shows where squeezing them takes long
SLOW_S = (
    120.0  # where the first search came to nothing: the machine is busy, or compiled its kernels
)
QUICK = {"particles": 8000}  # of [search]: a rough tree in the time there is
TRIALS = 5000  # so that shares are whole hundredths of a percent
LEAST_ROOM_MM = 4.0  # between open fingers and the part at any angle, for a gripper to be chosen
TURN_DEG = 20.0  # either way: as parts come from a chute; any angle is more than a minute's search
LARGEST = 1  # number of the contour that is taken
DRAWN_SQUEEZES = range(1, 4)  # of the path that the picture shows
WORTH_TELLING = 0.005  # share of the parts for which the search was not done
LEAST_DONE = 0.9  # share located of the parts for which the search was done, for that answer
MOST_OPEN = 0.5  # share of the parts for which it was not done, beyond which nothing is known
UNITS_ASSUMED = "one unit of the drawing is 1 mm, for it does not say (--units)"
LOCATABLE = {"good": True, "fair": True, "cut": True, "poor": False, "unknown": None}

ALL = "all"
EACH_S = 30.0  # for each gripper where all are compared

Read = TypeVar("Read")
Spared = Callable[
    [str], AbstractContextManager[None]
]  # work that the answer can do without, by its name


def parser() -> Parser:
    """The command's arguments."""
    built = shell.parser(
        NAME,
        "Can this part be located by squeezing, and how well? Plans for a minute, asks nothing, says what it "
        "assumed, and writes a job file, a table and a picture to go on with.",
        f"{NAME} part.dxf --units mm",
        f"{NAME} part.svg --units mm --gripper hand-e --radius 5 -o first/part.toml",
    )
    built.add_argument("drawing", type=Path, help=f"of the part: {', '.join(SUFFIXES)}")
    built.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="JOB.toml",
        help="the job file; table and picture go beside it (default: named after the drawing, and "
        "numbered where another job has the name, in this folder)",
    )
    shell.add_drawing(built.add_argument_group("the drawing"))
    add = built.add_argument_group("in place of defaults").add_argument
    add(
        "--radius",
        type=number,
        metavar="MM",
        help="the part's centre lies in a disc of this radius",
    )
    add(
        "--turn",
        type=number,
        metavar="DEG",
        help=f"it is turned by at most this (default: {TURN_DEG:g})",
    )
    add(
        "--gripper",
        choices=[*GRIPPERS, ALL],
        help=f"which one (default: the first that opens wide enough); {ALL}: compare them in one table, each "
        "planned for --budget (default: half a minute), and write nothing",
    )
    add("--fingers", choices=FINGERS, help="what they are faced with (default: rubber)")
    add(
        "--distance",
        type=number,
        default=3.0,
        metavar="MM",
        help="how well the part must be located (default: %(default)s)",
    )
    add(
        "--thickness",
        type=positive,
        metavar="MM",
        help="of the part (default: that of a solid; of an outline nobody knows it)",
    )
    add(
        "--budget",
        type=seconds_text,
        metavar="30s",
        help="for the answer, once kernels are loaded (default: a minute)",
    )
    built.add_argument(
        "--follow",
        action="store_true",
        help="print progress as JSON, one object a line, on standard error",
    )
    return built


class Files(NamedTuple):
    """What is written."""

    job: Path
    table: Path
    picture: Path


class Setting(NamedTuple):
    """What a job is begun with."""

    answers: Answers
    assumed: list[str]  # what was not stated
    restrictions: list[
        str
    ]  # what was assumed because the part is large, as clauses: "within 1 mm of ..."


def _try(arguments: argparse.Namespace) -> None:
    if arguments.gripper == ALL:
        _compare(arguments)
        return
    started = time.monotonic()
    if arguments.output is not None:
        usable(arguments.output, arguments.drawing)
    imported, notes = imported_of(arguments)
    setting = setting_of(arguments, imported)
    answers, rectangle = setting.answers, smallest_rectangle(imported.outline_mm)
    figures: dict[str, Any] = {
        "part": answers.name,
        "size_mm": [rectangle.length_mm, rectangle.width_mm],
        "turn_deg": rectangle.turn_deg,
        "assumed": [*notes, *setting.assumed],
    }
    if not arguments.json:
        print(f"{answers.name}: {rectangle.text()}, {len(imported.outline_mm)} vertices")
        for line in figures["assumed"]:
            say(f"assumed: {line}")
    failures: list[str] = []
    spared = partial(shell.spared, notes=failures, debug=arguments.debug)
    try:
        check_thickness(imported)
        text = draft(imported, arguments.drawing.name, answers)
        files = _files(arguments, text)
        write(files.job, text)
        figures["job"] = str(files.job)
        job = job_file.load(files.job)
        figures["alike"] = [result.line() for result in alike(job)]
        if not arguments.json:
            print("".join(f"note: {line}\n" for line in figures["alike"]), end="", flush=True)
        with _progress(arguments, course.unknown) as report, shell.compiling():
            report("kernels", 0, 1)
            make(job, seed=0).squeeze((0.0, 0.0, 0.0))
        ready = time.monotonic()
        answer_s = arguments.budget or max(LEAST_ANSWER_S, ANSWER_S - (ready - started))
        with _progress(arguments, course.of_time(answer_s)) as report:
            plan = _planned(job, answer_s, arguments.budget is None, report)
            dump(plan.table, files.table)
            part_s = seconds_a_part(plan.table, job, Threads())
            left_s = ready + answer_s - PICTURE_S - time.monotonic()
            trials = affordable(job, left_s, part_s)
            answer = _answered(job, plan, setting.restrictions, trials, spared, report)
    except (FitError, NoPlanError) as error:
        known = not getattr(error, "cut_short", False)
        reason = {"locatable": False if known else None, "verdict": "poor" if known else "unknown"}
        short = f"No: {error}." if known else f"Not known: {error}; give it a longer --budget."
        refused = {**figures, **reason, "answer": short, "reason": str(error)}
        shell.answer(arguments.json, refused, "", f"{QUESTION} {short}")
        return
    if not arguments.json:
        print("\n".join(["", *answer.lines()]), flush=True)
    picture: Path | None = None
    with spared("picture"):
        drawn = min(TRIALS, max(LEAST_DRAWN, int(PICTURE_S / part_s)))
        beliefs = replay(plan.table, job, drawn, plan.seed)
        shown = plan.table, job, beliefs, DRAWN_SQUEEZES, imported.holes_mm
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


def _progress(arguments: argparse.Namespace, whole: course.Whole) -> AbstractContextManager[Report]:
    if arguments.follow:
        return nullcontext(course.objects(whole))
    return shell.progress(arguments.json, whole)


def _planned(job: Job, answer_s: float, patient: bool, report: Report) -> Plan:
    """The plan that the time until an answer [s] is enough for; if `patient`, else in longer time."""
    search_s = answer_s - min(REST_S, REST * answer_s)
    return _within(
        job.replaced(search=QUICK), [search_s, SLOW_S] if patient else [search_s], report
    )


def _answered(
    job: Job, plan: Plan, restrictions: list[str], trials: int, spared: Spared, report: Report
) -> Answer:
    """How a plan does in its own world, and in others by so many trials each; what limits it."""
    figures, lines, limits = plan.evaluation.summary(), list[Line](), list[str]()
    with spared("other worlds"):
        lines = tried(plan.table, job, plan.evaluation, trials, Threads(), report)
    open_share = plan.cut.open_share if plan.cut else 0.0
    if plan.cut and open_share >= WORTH_TELLING:
        limits = [plan.cut.line()]
    elif figures["success_rate"] < 1.0:
        with spared("advice"):
            limits = advise(plan.table, plan.evaluation, job).lines()
    result = verdict(job, figures, lines)
    short = _short(result.grade, figures["success_rate"], open_share)
    most, worst, confidence = plan.table.limits.max_depth, weakest(lines), job.goal.confidence
    return Answer(short, result, figures, most, worst, limits, restrictions, confidence)


def _short(grade: Grade, success: float, open_share: float) -> str:
    """The grade of a plan; of one whose search is not done, what is known so far."""
    if grade != "poor" or not open_share:
        return grade
    if open_share > MOST_OPEN:
        return "unknown"
    return grade if success < LEAST_DONE * (1.0 - open_share) else "cut"


def check_thickness(imported: Imported) -> None:
    """Refuses a part that is too thin for finger tips, whatever the plan.

    Raises:
        FitError: it is.
    """
    height_mm = imported.height_mm
    if height_mm is not None and tips_height_mm(height_mm) <= 0.0:
        thin = f"it is {height_mm:.3g} mm thin"
        raise FitError(
            f"{thin}, and finger tips must close {MARGIN_MM:g} mm below its top or lower"
        )


def _within(job: Job, budgets: Sequence[float], report: Report) -> Plan:
    """The plan within the first of some times [s] that is enough for one.

    Raises:
        NoPlanError: none is, or there is no plan.
    """
    limit = Limit(budgets[0])
    try:
        with shell.stopping(limit, NAME):
            return compile_job(job, None, TRIALS, report, limit)
    except NoPlanError as error:
        if not error.cut_short or limit.asked or len(budgets) == 1:
            raise
    return _within(job, budgets[1:], report)


HEAD = f"{'gripper':16} {'step':>8}  located  squeezes  seconds  error (95 %)"


def _compare(arguments: argparse.Namespace) -> None:
    """Plans the same job for each gripper, and prints a line for each."""
    if arguments.output is not None:
        raise UsageError(f"--gripper {ALL} writes no job; leave out --output")
    imported, notes = imported_of(arguments)
    check_thickness(imported)
    fitting = [name for name in GRIPPERS if room_mm(imported, GRIPPERS[name]) >= LEAST_ROOM_MM]
    if not fitting:
        raise UsageError("no gripper that is known opens wide enough for the part")
    if arguments.radius is None:  # the same for all
        arguments.radius = min(proposed_radius_mm(imported, GRIPPERS[name]) for name in fitting)
    arguments.gripper = fitting[0]
    setting = setting_of(arguments, imported)
    if not arguments.json:
        print("".join(f"assumed: {line}\n" for line in (*notes, *setting.assumed)), end="")
        print(
            f"assumed: its centre within {arguments.radius:g} mm of the expected place (--radius)"
        )
        print(HEAD, flush=True)
    rows = [_row(arguments, imported, setting.answers, name) for name in fitting]
    if arguments.json:
        shell.answer(True, {"part": setting.answers.name, "grippers": rows})


def _row(
    arguments: argparse.Namespace, imported: Imported, answers: Answers, name: str
) -> dict[str, Any]:
    """What comes of the job with one gripper; its line is printed."""
    text = draft(imported, arguments.drawing.name, answers._replace(gripper=name))
    job = job_file.parse(text, name)
    step_mm = job.gripper.resolution_mm
    try:
        with _progress(arguments, course.unknown) as report, shell.compiling():
            plan = _planned(job, arguments.budget or EACH_S, False, report)
    except NoPlanError as failure:
        if not arguments.json:
            print(f"{name:16} {step_mm:5.2f} mm  no: {failure}", flush=True)
        return {"gripper": name, "step_mm": step_mm, "reason": str(failure)}
    figures = plan.evaluation.summary()
    located, off_mm = figures["success_rate"], figures["error_mm"]
    if not arguments.json:
        line = f"{name:16} {step_mm:5.2f} mm  {located:7.2%}  {figures['mean_squeezes']:8.2f}"
        off = f"{off_mm['median']:.2f} mm ({off_mm['p95']:.2f})" if off_mm else "-"
        print(f"{line}  {figures['seconds_mean']:7.1f}  {off}", flush=True)
    shown = ("success_rate", "mean_squeezes", "seconds_mean", "error_mm")
    return {"gripper": name, "step_mm": step_mm, **{key: figures[key] for key in shown}}


def imported_of(arguments: argparse.Namespace) -> tuple[Imported, list[str]]:
    """The outline, and what was assumed of the drawing: its largest contour, and mm where nothing is said."""
    options = shell.drawing_of(arguments)
    options = options._replace(contour=options.contour or LARGEST)
    imported, notes = in_mm(read_outline, arguments.drawing, options)
    if arguments.thickness is not None:
        imported = imported._replace(height_mm=arguments.thickness)
    return imported, [*notes, *imported.notes]


def in_mm(
    read: Callable[[Path, Options], Read], path: Path, options: Options
) -> tuple[Read, list[str]]:
    """What a reader makes of a drawing, in mm where nothing says the unit; and that this was assumed."""
    try:
        return read(path, options), []
    except UnitsMissingError:
        return read(path, options._replace(units="mm")), [UNITS_ASSUMED]


def setting_of(arguments: argparse.Namespace, imported: Imported) -> Setting:
    """The answers that a job needs, and which of them are defaults."""
    taken, restrictions = list[str](), list[str]()
    rooms = {name: room_mm(imported, preset) for name, preset in GRIPPERS.items()}
    gripper, usual = arguments.gripper, next(iter(GRIPPERS))
    if gripper is None:
        widest = max(rooms, key=lambda name: rooms[name])
        gripper = next((name for name, room in rooms.items() if room >= LEAST_ROOM_MM), widest)
        larger = "" if gripper == usual else f", since a {usual} does not open wide enough"
        taken.append(f"gripper {gripper}{larger} (--gripper)")
        if larger:
            restrictions.append(f"with a {gripper}")
    fingers = arguments.fingers or "rubber"
    pads = FINGERS[fingers]
    if arguments.fingers is None:
        taken.append(f"{pads.material}, friction {pads.low:g} to {pads.high:g} (--fingers)")
    turn = TURN_DEG if arguments.turn is None else arguments.turn
    if arguments.turn is None:
        taken.append(
            f"turned by at most {turn:g} degrees (--turn; 180 is any angle, and takes longer)"
        )
    radius = arguments.radius
    if radius is None:
        radius = proposed_radius_mm(imported, GRIPPERS[gripper])
        room = "" if radius >= MOST_RADIUS_MM else ", for the open jaws leave no more room"
        taken.append(f"its centre within {radius:g} mm of the expected place{room} (--radius)")
        if room:
            restrictions.append(f"within {radius:g} mm of the expected place")
    taken.append(f"located means to {arguments.distance:g} mm (--distance)")
    height = imported.height_mm
    if height is None:
        taken.append(f"at least {tips_height_mm(None) + MARGIN_MM:g} mm high (--thickness)")
    name = arguments.drawing.stem
    answers = Answers(name, radius, turn, gripper, fingers, arguments.distance, height)
    return Setting(answers._replace(tips_mm=arguments.height), taken, restrictions)


def _files(arguments: argparse.Namespace, text: str) -> Files:
    """Where to write: the job file asked for, or the first of its name that is free or says the same."""
    stem, number = arguments.drawing.stem, 1
    job = arguments.output or Path(f"{stem}.toml")
    while arguments.output is None and job.exists() and not _says(job, text):
        number += 1
        job = Path(f"{stem}-{number}.toml")
    files = Files(job, job.with_suffix(".msgpack"), job.with_suffix(".look.svg"))
    if job.exists() and not _says(job, text):
        raise UsageError(f"{job} is there already; name another file")
    for path in files:
        usable(path, arguments.drawing)
    return files


def _says(path: Path, text: str) -> bool:
    return path.is_file() and path.read_bytes() == text.encode()


def _next(files: Files, picture: Path | None, plan: Plan, seconds: float) -> list[str]:
    """What was written, and what to do with it."""
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
