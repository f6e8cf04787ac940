"""Comparison of grippers: one plan for each gripper that opens wide enough, in one table."""

import argparse
from textwrap import wrap
from typing import Any

from planner.cli import course, shell
from planner.cli.first_plan import (
    LEAST_ROOM_MM,
    check_thickness,
    imported_of,
    planned_within,
    progress_of,
    setting_of,
)
from planner.errors import NoPlanError
from planner.job import model as job_file
from planner.job.drafts import (
    GRIPPERS,
    Answers,
    draft,
    opening_of,
    proposed_radius_mm,
    room_mm,
)
from planner.part.importers.file import Imported
from runtime.shell.errors import UsageError

ALL = "all"
EACH_S = 30.0  # for each gripper when all are compared
HEAD = f"{'gripper':16} {'step':>8}  located  squeezes  seconds  error (95 %)"


def compare(arguments: argparse.Namespace) -> None:
    """Plans the same job for each gripper, and prints a line for each."""
    if arguments.output is not None:
        raise UsageError(f"--gripper {ALL} writes no job; leave out --output")
    imported, notes = imported_of(arguments)
    check_thickness(imported)
    fitting = [name for name in GRIPPERS if room_mm(imported, name) >= LEAST_ROOM_MM]
    if not fitting:
        raise UsageError("no known gripper opens wide enough for the part")
    if arguments.radius is None:  # the same for all grippers
        arguments.radius = min(proposed_radius_mm(imported, name) for name in fitting)
    arguments.gripper = fitting[0]
    setting = setting_of(arguments, imported)
    if not arguments.json:
        print("".join(f"assumed: {line}\n" for line in (*notes, *setting.assumed)), end="")
        print(
            f"assumed: its centre within {arguments.radius:g} mm of the expected place (--radius)"
        )
        print(HEAD, flush=True)
    rows = [
        _row(arguments, imported, setting.answers, name)
        if name in fitting
        else _small(arguments, name)
        for name in GRIPPERS
    ]
    if arguments.json:
        shell.answer(True, {"part": setting.answers.name, "grippers": rows})


def _small(arguments: argparse.Namespace, name: str) -> dict[str, Any]:
    """What there is to say of a gripper that does not open wide enough; its line is printed."""
    step_mm = GRIPPERS[name].resolution_um / 1000
    reason = f"it opens to {opening_of(name):g} mm, too little for the part"
    return _unplanned(arguments, name, step_mm, reason)


def _unplanned(
    arguments: argparse.Namespace, name: str, step_mm: float, reason: str
) -> dict[str, Any]:
    """The same with the reason, in lines that a terminal of 80 columns shows as a table."""
    if not arguments.json:
        row = f"{name:16} {step_mm:5.2f} mm  "
        lines = wrap(f"no: {reason}", 80 - len(row), break_long_words=False)
        print(row + ("\n" + " " * len(row)).join(lines), flush=True)
    return {"gripper": name, "step_mm": step_mm, "reason": reason}


def _row(
    arguments: argparse.Namespace, imported: Imported, answers: Answers, name: str
) -> dict[str, Any]:
    """Plans the job with one gripper and prints its line."""
    text = draft(imported, arguments.drawing.name, answers._replace(gripper=name))
    job = job_file.parse(text, name)
    step_mm = job.gripper.resolution_mm
    try:
        with progress_of(arguments, course.unknown) as report, shell.compiling():
            plan = planned_within(job, arguments.budget or EACH_S, False, report)
    except NoPlanError as failure:
        reason = "not done in time (--budget)" if failure.cut_short else str(failure)
        return _unplanned(arguments, name, step_mm, reason)
    figures = plan.evaluation.summary()
    located, off_mm = figures["success_rate"], figures["error_mm"]
    if not arguments.json:
        line = f"{name:16} {step_mm:5.2f} mm  {located:7.2%}  {figures['mean_squeezes']:8.2f}"
        off = f"{off_mm['median']:.2f} mm ({off_mm['p95']:.2f})" if off_mm else "-"
        print(f"{line}  {figures['seconds_mean']:7.1f}  {off}", flush=True)
    shown = ("success_rate", "mean_squeezes", "seconds_mean", "error_mm")
    return {"gripper": name, "step_mm": step_mm, **{key: figures[key] for key in shown}}
