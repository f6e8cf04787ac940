"""Compares grippers for one part: prints a row for each, with a plan if it opens wide enough."""

import argparse
from textwrap import wrap
from typing import Any

from planner.cli import course, first_plan, shell
from planner.errors import NoPlanError
from planner.job import model as job_file
from planner.job.drafts import GRIPPERS, Answers, draft, opening_of, proposed_radius_mm, room_mm
from planner.part.importers.file import Imported
from runtime.shell.errors import UsageError

ALL = "all"
SHOWN = ("success_rate", "mean_squeezes", "seconds_mean", "error_mm")
EACH_S = 30.0  # time for each gripper when all are compared
HEAD = f"{'gripper':16} {'step':>8}  located  squeezes  seconds  error (95 %)"


def compare(arguments: argparse.Namespace) -> None:
    """Plans the same job for each gripper that opens wide enough, and prints a line for every gripper."""
    if arguments.output is not None:
        raise UsageError(f"--gripper {ALL} writes no job; leave out --output")
    imported, notes = first_plan.imported_of(arguments)
    first_plan.check_thickness(imported)
    fitting = [name for name in GRIPPERS if room_mm(imported, name) >= first_plan.LEAST_ROOM_MM]
    if not fitting:
        raise UsageError("no known gripper opens wide enough for the part")
    if arguments.radius is None:  # the same for all grippers
        arguments.radius = min(proposed_radius_mm(imported, name) for name in fitting)
    arguments.gripper = fitting[0]
    setting = first_plan.setting_of(arguments, imported)
    say = shell.printer(arguments.json)
    place = f"its centre within {arguments.radius:g} mm of the expected place (--radius)"
    for line in (*notes, *setting.assumed, place):
        say(f"assumed: {line}")
    say(HEAD, flush=True)
    rows = []
    for name in GRIPPERS:
        rows.append(_row(arguments, imported, setting.answers._replace(gripper=name)))
        say(_line(rows[-1]), flush=True)
    if arguments.json:
        shell.answer(True, {"part": setting.answers.name, "grippers": rows})


def _row(arguments: argparse.Namespace, imported: Imported, answers: Answers) -> dict[str, Any]:
    """The figures of a plan with one gripper, or the reason why there is none."""
    name = answers.gripper
    if room_mm(imported, name) < first_plan.LEAST_ROOM_MM:
        step_mm = GRIPPERS[name].resolution_um / 1000
        reason = f"it opens to {opening_of(name):g} mm, too little for the part"
        return {"gripper": name, "step_mm": step_mm, "reason": reason}
    job = job_file.parse(draft(imported, arguments.drawing.name, answers), name)
    row = {"gripper": name, "step_mm": job.gripper.resolution_mm}
    try:
        with first_plan.progress_of(arguments, course.unknown) as report, shell.compiling():
            plan = first_plan.planned_within(job, arguments.budget or EACH_S, False, report)
    except NoPlanError as failure:
        reason = "not done in time (--budget)" if failure.cut_short else str(failure)
        return row | {"reason": reason}
    figures = plan.evaluation.summary()
    return row | {key: figures[key] for key in SHOWN}


def _line(row: dict[str, Any]) -> str:
    """A row as text under `HEAD`, wrapped at 80 columns."""
    begin = f"{row['gripper']:16} {row['step_mm']:5.2f} mm  "
    if "reason" in row:
        lines = wrap(f"no: {row['reason']}", 80 - len(begin), break_long_words=False)
        return begin + ("\n" + " " * len(begin)).join(lines)
    off_mm = row["error_mm"]
    off = f"{off_mm['median']:.2f} mm ({off_mm['p95']:.2f})" if off_mm else "-"
    effort = f"{row['mean_squeezes']:8.2f}  {row['seconds_mean']:7.1f}"
    return f"{begin}{row['success_rate']:7.2%}  {effort}  {off}"
