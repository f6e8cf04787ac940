"""What plan-compile --models-report says about the learned models of a job."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from planner.cli import shell
from planner.diagnosis.model_quality import ActionQuality, Quality, quality
from planner.errors import UsageError
from planner.job import Job
from planner.learned.learning import learned_model
from planner.learned.store import Store
from planner.mechanics.simulator import Simulator
from planner.paper.collision import Confusion
from planner.progress import Report
from planner.scheduler import Scheduler

PICTURES = (".png", ".svg", ".pdf")
BESIDE = "beside the table"
"""What the option has for its value when no file is named."""


class Told(NamedTuple):
    """The report for machines and for people."""

    figures: dict[str, Any]
    text: str


def picture_path(value: str, table: Path) -> Path:
    """The file for the picture of the partition.

    Args:
        value: of the option.
        table: the table that is compiled.

    Raises:
        UsageError: the name does not end like a picture's.
    """
    path = table.with_suffix(".models.svg") if value == BESIDE else Path(value)
    if path.suffix.lower() not in PICTURES:
        raise UsageError(f"--models-report {path} must end in {', '.join(PICTURES)}")
    return path


def judge(
    job: Job, workers: int | None, store: Store | None, scheduler: Scheduler, report: Report, picture: Path
) -> Quality:
    """Learns the models of a job, judges them, and draws the partition.

    Raises:
        ClusterError: the cluster was lost.
    """
    from planner.report import subspaces  # matplotlib takes a second

    simulator = Simulator.of_job(job, workers)
    model, rolled = learned_model(job, simulator, store, scheduler, report)
    judged = quality(job, model, rolled, report)
    subspaces.figure(judged, simulator.outline, simulator.jaws, picture)
    return judged


def made(
    job: Job, workers: int | None, store: Store | None, scheduler: Scheduler, report: Report, picture: Path
) -> Told:
    """Judges the models of a job, and writes the picture and, beside it, the figures for plan-report.

    Raises:
        ClusterError: the cluster was lost.
        InputFileError: a file cannot be written.
    """
    judged = judge(job, workers, store, scheduler, report, picture)
    told = figures(judged, picture, job.digest())
    beside = picture.with_suffix(".json")
    with shell.writing(beside) as draft:
        draft.write_text(json.dumps(told) + "\n", encoding="utf-8")
    return Told(told, text(judged, [picture, beside]))


def figures(judged: Quality, picture: Path, job_digest: bytes) -> dict[str, Any]:
    """The report in plain types, and which job it is about."""
    subspaces = judged.subspaces
    opened, anywhere = judged.collision
    return {
        "job_digest": job_digest.hex(),
        "rollouts": judged.rollouts,
        "colliding": judged.colliding,
        "spacing_mm": judged.spacing_mm,
        "h1_mm": judged.h1_mm,
        "h2": judged.h2,
        "actions": [_action(action) for action in judged.actions],
        "actions_in_collision": judged.in_collision,
        "sensor": judged.sensor._asdict(),
        "collision": {"fully_open": _confusion(opened), "any_opening": _confusion(anywhere)},
        "subspaces": [
            {"low_mm": float(low), "mean_mm": float(mean), "high_mm": float(high), "rollouts": int(size)}
            for low, mean, high, size in zip(
                subspaces.low_mm, subspaces.mean_mm, subspaces.high_mm, subspaces.size, strict=True
            )
        ],
        "notes": subspaces.notes(),
        "picture": str(picture),
    }


def text(judged: Quality, written: Sequence[Path]) -> str:
    """The report for a terminal, and the files where it is."""
    from planner.report.subspaces import name

    sensor, motion = judged.sensor, f"h1 {judged.h1_mm:.3f} mm, h2 {judged.h2:.3g} of the scatter near by"
    lines = [
        f"models of {judged.rollouts} roll-outs, {judged.spacing_mm:.2f} mm apart; {motion}",
        "motion: energy distance to the simulator, that between two runs of the simulator, their ratio:",
        *(_action_line(action) for action in judged.actions),
    ]
    if judged.in_collision:
        lines.append(f"  {judged.in_collision} more actions collide with the belief")
    lines.append(
        f"sensor: error {sensor.median_mm:.3f} mm in the middle, {sensor.q95_mm:.3f} mm kept by 95 %, "
        f"{sensor.worst_mm:.2f} mm at worst, of {sensor.held_out} roll-outs held out"
    )
    for opening, confusion in zip(("fully open", "opened anywhere"), judged.collision, strict=True):
        lines.append(
            f"collision detector, jaws {opening}: {confusion.miss_rate:.3%} of {confusion.colliding} "
            f"colliding placements called free, {confusion.false_alarm_rate:.1%} of {confusion.free} free "
            "ones colliding"
        )
    names = "; ".join(name(judged, k) for k in range(len(judged.subspaces)))
    lines += [
        f"widths: {names}",
        *(f"  {note}" for note in judged.subspaces.notes()),
        f"wrote {' and '.join(map(str, written))}",
    ]
    return "\n".join(lines)


def _action(action: ActionQuality) -> dict[str, Any]:
    x, y, theta = (float(value) for value in action.placement)
    compared = action.comparison
    return {
        "x_mm": x, "y_mm": y, "theta_rad": theta, "model_mm": compared.model_mm,
        "simulator_mm": compared.simulator_mm,
        "ratio": compared.ratio if math.isfinite(compared.ratio) else None, "simulated": action.simulated,
    }  # fmt: skip


def _action_line(action: ActionQuality) -> str:
    x, y, theta = action.placement
    compared = action.comparison
    return (
        f"  ({x:.1f}, {y:.1f}) mm, {math.degrees(theta):6.1f} deg: {compared.model_mm:.5f} mm, "
        f"{compared.simulator_mm:.5f} mm, {compared.ratio:.2f}; {action.simulated:.0%} simulated"
    )


def _confusion(confusion: Confusion) -> dict[str, Any]:
    return {
        **confusion._asdict(),
        "miss_rate": confusion.miss_rate,
        "false_alarm_rate": confusion.false_alarm_rate,
    }
