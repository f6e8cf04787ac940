"""plan-try: from a drawing to a first answer in a minute, and the files to go on with."""

import argparse
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from planner.cli import shell
from planner.compile import Plan, compile_job
from planner.diagnosis.advice import advise
from planner.errors import FitError, NoPlanError, UsageError
from planner.evaluation.cases import assumption_cases
from planner.evaluation.evaluate import sweep
from planner.job import model as job_file
from planner.job.drafts import FINGERS, GRIPPERS, Answers, draft, proposed_radius_mm, room_mm
from planner.job.model import Job
from planner.part.importers.file import SUFFIXES, Imported, read_outline
from planner.part.outline import smallest_rectangle
from planner.report import canvas, paper_figures
from planner.report.replay import replay
from planner.report.verdict import Weakest, error_text, percent, verdict, weakest
from planner.work.limit import Limit
from planner.work.progress import Report
from planner.work.scheduler import Threads
from planner.world import ContactWorlds, make
from runtime.shell.command import Parser, number, say
from runtime.shell.files import quoted, usable, write
from runtime.table import dump

NAME = "plan-try"
ANSWER_S = 45.0  # from the start to the answer, the picture aside
LEAST_SEARCH_S = 8.0
SLOW_S = 120.0  # where the first search came to nothing: the machine is busy, or compiled its kernels
QUICK = {"particles": 8000}  # of [search]: a rough tree in the time there is
TRIALS = 4000
WORLD_TRIALS = 1000
LEAST_ROOM_MM = 4.0  # between open fingers and the part at any angle, for a gripper to be chosen
TURN_DEG = 20.0  # either way: as parts come from a chute; any angle is more than a minute's search
LARGEST = 1  # number of the contour that is taken
DRAWN_SQUEEZES = range(1, 4)  # of the path that the picture shows
ANSWERS = {
    "good": "Yes.",
    "fair": "Yes, but not in every case: see what limits it and what it leans on.",
    "poor": "Not well enough: see what limits it.",
    "cut": "Yes, as far as the search came; plan for longer to know the rest.",
}
WORTH_TELLING = 0.005  # share of the parts for which the search was not done
LEAST_DONE = 0.9  # share located of the parts for which the search was done, for that answer


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
        "-o", "--output", type=Path, metavar="JOB.toml",
        help="the job file; table and picture go beside it (default: named after the drawing, and "
        "numbered where another job has the name, in this folder)",
    )  # fmt: skip
    shell.add_drawing(built.add_argument_group("the drawing"))
    add = built.add_argument_group("in place of defaults").add_argument
    add("--radius", type=number, metavar="MM", help="the part's centre lies in a disc of this radius")
    add("--turn", type=number, metavar="DEG", help=f"it is turned by at most this (default: {TURN_DEG:g})")
    add("--gripper", choices=GRIPPERS, help="which one (default: the first that opens wide enough)")
    add("--fingers", choices=FINGERS, help="what they are faced with (default: rubber)")
    add(
        "--distance", type=number, default=3.0, metavar="MM",
        help="how well the part must be located (default: %(default)s)",
    )  # fmt: skip
    add("--budget", type=shell.seconds, metavar="30s", help="for the search (default: what a minute leaves)")
    return built


class Files(NamedTuple):
    """What is written."""

    job: Path
    table: Path
    picture: Path


class Answer(NamedTuple):
    """What was found."""

    short: str  # a key of `ANSWERS`
    sentence: str  # the verdict on the plan as it is
    figures: dict[str, Any]  # as `Evaluation.summary` returns them
    worst: Weakest | None
    limits: list[str]  # what limits the plan, one sentence each


def _try(arguments: argparse.Namespace) -> None:
    started = time.monotonic()
    if arguments.output is not None:
        usable(arguments.output, arguments.drawing)
    imported, notes = _imported(arguments)
    answers, taken = _defaults(arguments, imported)
    rectangle = smallest_rectangle(imported.outline_mm)
    told: dict[str, Any] = {
        "part": answers.name, "size_mm": [rectangle.length_mm, rectangle.width_mm],
        "turn_deg": rectangle.turn_deg, "assumed": [*notes, *taken],
    }  # fmt: skip
    if not arguments.json:
        print(f"{answers.name}: {rectangle.text()}, {len(imported.outline_mm)} vertices")
        for line in told["assumed"]:
            say(f"assumed: {line}")
    try:
        text = draft(imported, arguments.drawing.name, answers)
        files = _files(arguments, text)
        write(files.job, text)
        told["job"] = str(files.job)
        with shell.progress(arguments.json) as report:
            job = job_file.load(files.job)
            plan, answer = _planned(arguments, job, started, report)
            dump(plan.table, files.table)
            report("picture", 0, 1)
            beliefs = replay(plan.table, job, TRIALS, plan.seed)
            shown = plan.table, job, beliefs, DRAWN_SQUEEZES, imported.holes_mm
            canvas.save(files.picture, lambda: paper_figures.sequence(*shown))
    except (FitError, NoPlanError) as error:
        known = not getattr(error, "cut_short", False)
        reason = {"locatable": False if known else None, "verdict": "poor" if known else "unknown"}
        short = f"No: {error}." if known else f"Not known: {error}; give it a longer --budget."
        figures = {**told, **reason, "reason": str(error)}
        shell.answer(arguments.json, figures, "", f"Can it be located by squeezing? {short}")
        return
    seconds = time.monotonic() - started
    told |= {
        "locatable": answer.short != "poor", "verdict": answer.short, "sentence": answer.sentence,
        **answer.figures, "weakest": answer.worst and answer.worst._asdict(), "limits": answer.limits,
        "cut_short": plan.cut and plan.cut.figures(), "table": str(files.table),
        "picture": str(files.picture), "seconds": round(seconds, 1),
    }  # fmt: skip
    shell.answer(arguments.json, told, *_lines(answer, plan), *_next(files, plan, seconds))


def _planned(arguments: argparse.Namespace, job: Job, started: float, report: Report) -> tuple[Plan, Answer]:
    """The plan that the time is enough for, and how it does as planned and elsewhere."""
    report("kernels", 0, 1)
    make(job, seed=0).squeeze((0.0, 0.0, 0.0))
    quick = job.replaced(search=QUICK)
    left_s = ANSWER_S - (time.monotonic() - started)
    budgets = [arguments.budget] if arguments.budget else [max(LEAST_SEARCH_S, left_s), SLOW_S]
    plan = _within(quick, budgets, report)
    seed, cases = plan.seed, assumption_cases(job)
    worlds = partial(ContactWorlds.of_job, seed=seed)
    lines = list(sweep(plan.table, quick, cases, worlds, WORLD_TRIALS, seed, Threads(), report))
    open_share = plan.cut.open_share if plan.cut else 0.0
    limits = advise(plan.table, plan.evaluation, job).lines()
    if plan.cut and open_share >= WORTH_TELLING:
        limits = [plan.cut.line()]
    figures, worst = plan.evaluation.summary(), weakest(lines)
    grade, sentence, _ = verdict(job, figures, worst)
    done = figures["success_rate"] / max(1.0 - open_share, 1e-9)
    short = "cut" if grade == "poor" and open_share > 0.0 and done >= LEAST_DONE else grade
    return plan, Answer(short, sentence, figures, worst, limits)


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


def _imported(arguments: argparse.Namespace) -> tuple[Imported, list[str]]:
    """The outline, and what was assumed of the drawing: its largest contour, and mm where nothing is said."""
    options = shell.drawing_of(arguments)
    options = options._replace(contour=options.contour or LARGEST)
    try:
        imported = read_outline(arguments.drawing, options)
    except UsageError as error:
        if not error.units_missing:
            raise
        imported = read_outline(arguments.drawing, options._replace(units="mm"))
        return imported, ["one unit of the drawing is 1 mm, for it does not say (--units)", *imported.notes]
    return imported, list(imported.notes)


def _defaults(arguments: argparse.Namespace, imported: Imported) -> tuple[Answers, list[str]]:
    """The answers that a job needs, and which of them are defaults."""
    taken = []
    rooms = {name: room_mm(imported, preset) for name, preset in GRIPPERS.items()}
    gripper = arguments.gripper
    if gripper is None:
        widest = max(rooms, key=lambda name: rooms[name])
        gripper = next((name for name, room in rooms.items() if room >= LEAST_ROOM_MM), widest)
        taken.append(f"gripper {gripper} (--gripper)")
    fingers = arguments.fingers or "rubber"
    pads = FINGERS[fingers]
    if arguments.fingers is None:
        taken.append(f"{pads.told}, friction {pads.low:g} to {pads.high:g} (--fingers)")
    turn = TURN_DEG if arguments.turn is None else arguments.turn
    if arguments.turn is None:
        taken.append(f"turned by at most {turn:g} degrees (--turn; 180 is any angle, and takes longer)")
    radius = arguments.radius
    if radius is None:
        radius = proposed_radius_mm(imported, GRIPPERS[gripper])
        taken.append(f"its centre within {radius:g} mm of the expected place (--radius)")
    taken.append(f"located means to {arguments.distance:g} mm (--distance)")
    name = arguments.drawing.stem
    return Answers(name, radius, turn, gripper, fingers, arguments.distance, imported.height_mm), taken


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


def _lines(answer: Answer, plan: Plan) -> list[str]:
    figures = answer.figures
    low, high = figures["success_ci95"]
    located = f"{percent(figures['success_rate'])} (95 % interval {low:.2%} to {high:.2%})"
    others = {"wrong": "wrong_rate", "given up": "unresolved_rate", "rejected": "reject_rate"}
    shares = ", ".join(f"{word} {percent(figures[name])}" for word, name in others.items())
    most = f"{plan.table.limits.max_depth} at most"
    limits = [f"{'limit' if not k else '':10s} {line}" for k, line in enumerate(answer.limits)]
    return [
        "",
        f"Can it be located by squeezing? {ANSWERS[answer.short]}",
        f"The plan {answer.sentence}.",
        f"located    {located}, {shares}",
        f"error      {error_text(figures['error_mm']).removeprefix('expected error ')}",
        f"effort     {figures['mean_squeezes']:.2f} squeezes a part, {most}; {figures['mean_seconds']:.1f} s",
        f"weakest    {answer.worst.text() if answer.worst else 'not tried'}",
        *limits,
    ]


def _next(files: Files, plan: Plan, seconds: float) -> list[str]:
    """What was written, and what to do with it."""
    longer = " (a full search)" if plan.cut else ""
    job, table, report = map(quoted, (files.job, files.table, files.job.with_suffix(".html")))
    return [
        "",
        f"wrote {files.job}, {files.table} and {files.picture} after {seconds:.0f} s",
        f"look       {files.picture}",
        f"plan       squeezetree plan {job} -o {table}{longer}",
        f"report     squeezetree report {table} -o {report}",
        f"simulate   squeezetree run --tree {table} --port sim --time-scale 100 --count 20",
    ]


main = shell.main_of(parser, _try)
