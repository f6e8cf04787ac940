"""What plan-compile --models-report says about the learned models of a job."""

import json
import math
from pathlib import Path
from typing import Any

from planner.cli import shell
from planner.diagnosis.model_quality import ActionQuality, Quality, quality
from planner.job.model import Job
from planner.learned.model import learned_model
from planner.learned.store import Store
from planner.mechanics.simulator import Simulator
from planner.work.progress import Report
from planner.work.scheduler import Scheduler
from runtime.shell.files import write

BESIDE = "beside the table"  # what the option has for its value when no file is named


def picture_path(value: str, table: Path) -> Path:
    """The file for the picture of the partition: the value of the option, or beside the table.

    Raises:
        UsageError: the name does not end like a picture's.
    """
    path = table.with_suffix(".models.svg") if value == BESIDE else Path(value)
    return shell.checked_suffix("--models-report", path, shell.PICTURES)


def made(
    job: Job, workers: int | None, store: Store | None, scheduler: Scheduler, report: Report, picture: Path
) -> tuple[dict[str, Any], str]:
    """Learns and judges the models of a job; writes the picture and, beside it, the figures for plan-report.

    Returns the report for machines and for people.

    Raises:
        ClusterError: the cluster was lost.
        OutputError: a file cannot be written.
    """
    from planner.report import canvas, paper_figures  # matplotlib takes a second

    simulator = Simulator.of_job(job, workers)
    model, rolled = learned_model(job, simulator, store, scheduler, report)
    judged = quality(job, model, rolled, report)
    shown = judged.subspaces, judged.label, judged.final, simulator.outline, simulator.jaws, names(judged)
    canvas.save(picture, lambda: paper_figures.subspaces(*shown))
    told = {"job_digest": job.digest().hex(), **figures(judged), "picture": str(picture)}
    beside = picture.with_suffix(".json")
    write(beside, json.dumps(told) + "\n")
    return told, f"{text(judged)}\nwrote {picture} and {beside}"


def names(judged: Quality) -> list[str]:
    """What the subspaces are called: the widths in each, and its share of the roll-outs."""
    found = judged.subspaces
    shares = found.size / max(found.size.sum(), 1)
    spans = [f"{low:.1f} to {high:.1f} mm" for low, high in zip(found.low_mm, found.high_mm, strict=True)]
    spans[0] = "free space"
    return [f"{span}, {share:.0%}" for span, share in zip(spans, shares, strict=True)]


def figures(judged: Quality) -> dict[str, Any]:
    """The report in plain types."""
    return {
        "rollouts": judged.rollouts,
        "colliding": judged.colliding,
        "spacing_mm": judged.spacing_mm,
        "h1_mm": judged.h1_mm,
        "h2_mm": judged.h2_mm,
        "actions": [_action(action) for action in judged.actions],
        "actions_in_collision": judged.in_collision,
        "sensor": judged.sensor._asdict(),
        "collision": judged.collision._asdict(),
        "subspaces": judged.subspaces.figures(),
        "notes": judged.subspaces.notes(),
    }


def text(judged: Quality) -> str:
    """The report for a terminal."""
    sensor, collision = judged.sensor, judged.collision
    colliding = f"  {judged.in_collision} more actions collide with the belief"
    lines = [
        (
            f"models of {judged.rollouts} roll-outs, {judged.spacing_mm:.2f} mm apart; "
            f"h1 {judged.h1_mm:.3f} mm, h2 {judged.h2_mm:.3f} mm"
        ),
        "motion: energy distance to the simulator, that between two runs of the simulator, their ratio:",
        *map(_action_line, judged.actions),
        *([colliding] if judged.in_collision else []),
        (
            f"sensor: error {sensor.median_mm:.3f} mm in the middle, {sensor.q95_mm:.3f} mm kept by 95 %, "
            f"{sensor.worst_mm:.2f} mm at worst, of {sensor.held_out} roll-outs held out"
        ),
        (
            f"collision detector, jaws fully open: {collision.miss_rate:.3%} of {collision.colliding} "
            f"colliding placements called free, {collision.false_alarm_rate:.1%} of {collision.free} free "
            "ones colliding"
        ),
        f"widths: {'; '.join(names(judged))}",
        *(f"  {note}" for note in judged.subspaces.notes()),
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
