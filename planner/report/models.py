"""How good the learned models of a job are: what `plan-compile --models-report` says, and a page shows."""

import json
import math
from pathlib import Path
from typing import Any, TypeAlias

from planner.diagnosis.model_quality import ActionQuality, Quality, quality
from planner.errors import InputFileError
from planner.job.model import Job
from planner.learned.model import learned_model
from planner.learned.store import Store
from planner.mechanics.simulator import Simulator
from planner.work.progress import Report
from planner.work.scheduler import Scheduler
from runtime.shell import strict_json
from runtime.shell.files import write


def made(
    job: Job,
    workers: int | None,
    store: Store | None,
    scheduler: Scheduler,
    report: Report,
    picture: Path,
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
    shown = (
        judged.subspaces,
        judged.label,
        judged.final,
        simulator.outline,
        simulator.jaws,
        names(judged),
    )
    canvas.save(picture, lambda: paper_figures.subspaces(*shown))
    record = {"job_digest": job.digest().hex(), **figures(judged), "picture": str(picture)}
    beside = picture.with_suffix(".json")
    write(beside, json.dumps(record) + "\n")
    return record, f"{text(judged)}\nwrote {picture} and {beside}"


def names(judged: Quality) -> list[str]:
    """What the subspaces are called: the widths in each, and its share of the roll-outs."""
    result = judged.subspaces
    shares = result.size / max(result.size.sum(), 1)
    spans = [
        f"{low:.1f} to {high:.1f} mm"
        for low, high in zip(result.low_mm, result.high_mm, strict=True)
    ]
    spans[0] = "free space"
    return [f"{span}, {share:.0%}" for span, share in zip(spans, shares, strict=True)]


def figures(judged: Quality) -> dict[str, Any]:
    """The report in plain types."""
    plain = ("rollouts", "colliding", "spacing_mm", "h1_mm", "h2_mm")
    return {
        **{name: getattr(judged, name) for name in plain},
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
        "x_mm": x,
        "y_mm": y,
        "theta_rad": theta,
        "model_mm": compared.model_mm,
        "simulator_mm": compared.simulator_mm,
        "ratio": compared.ratio if math.isfinite(compared.ratio) else None,
        "simulated": action.simulated,
    }


def _action_line(action: ActionQuality) -> str:
    x, y, theta = action.placement
    compared = action.comparison
    return (
        f"  ({x:.1f}, {y:.1f}) mm, {math.degrees(theta):6.1f} deg: {compared.model_mm:.5f} mm, "
        f"{compared.simulator_mm:.5f} mm, {compared.ratio:.2f}; {action.simulated:.0%} simulated"
    )


MAX_BYTES = 16 << 20
WRITE = "have plan-compile --models-report write it"

Models: TypeAlias = dict[str, Any]  # what a page shows of `figures`


def _number(told: Any) -> float:
    value = float(told)
    if not math.isfinite(value):
        raise ValueError(told)
    return value


# What must be there, and what reads it.
SHAPE: Models = {
    "job_digest": str,
    "rollouts": int,
    "colliding": _number,
    "spacing_mm": _number,
    "h1_mm": _number,
    "h2_mm": _number,
    "actions": [
        {
            "x_mm": _number,
            "y_mm": _number,
            "theta_rad": _number,
            "model_mm": _number,
            "simulator_mm": _number,
            "simulated": _number,
            "ratio": lambda told: None if told is None else _number(told),
        }
    ],
    "actions_in_collision": int,
    "sensor": {"median_mm": _number, "q95_mm": _number, "worst_mm": _number, "held_out": int},
    "collision": {"colliding": int, "free": int, "miss_rate": _number, "false_alarm_rate": _number},
    "subspaces": [{"low_mm": _number, "mean_mm": _number, "high_mm": _number, "rollouts": int}],
    "notes": [str],
}


def read(path: Path, job_digest: str) -> Models:
    """Reads a file of figures about the job of this digest (hexadecimal).

    Raises:
        InputFileError: it is missing, too large, no such file, or about another job.
    """

    def refused(problem: str) -> InputFileError:
        return InputFileError(f"{problem}; {WRITE}", where=str(path))

    record = strict_json.load(path, refused, MAX_BYTES)
    try:
        models: Models = _shaped(record.get("models", record), SHAPE)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise refused("does not tell the quality of models") from error
    digest = models["job_digest"]
    if digest != job_digest:
        raise refused(f"is about another job ({digest[:12]}, the table's is {job_digest[:12]})")
    return models


def _shaped(told: Any, shape: Any) -> Any:
    if isinstance(shape, dict):
        return {name: _shaped(told[name], inner) for name, inner in shape.items()}
    if isinstance(shape, list):
        if not isinstance(told, list):
            raise TypeError(told)
        return [_shaped(one, shape[0]) for one in told]
    return shape(told)
