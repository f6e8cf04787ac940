"""The quality of a job's learned models, as `plan-compile --models-report` measured it, read for a page.

The file is the one that the command writes beside its picture, or what it prints with --json.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from planner.errors import InputFileError
from runtime.shell import strict_json

MAX_BYTES = 16 << 20
WRITE = "have plan-compile --models-report write it"


class Action(NamedTuple):
    """The motion model under one action: energy distances [mm], and their ratio, None where it has none."""

    x_mm: float
    y_mm: float
    angle_deg: float
    model_mm: float
    simulator_mm: float
    ratio: float | None
    simulated: float


class Detector(NamedTuple):
    """The collision detector on fresh placements of one kind."""

    jaws: str
    colliding: int
    free: int
    miss_rate: float
    false_alarm_rate: float


class Span(NamedTuple):
    """Widths that stand for one subspace of poses [mm], and its share of the roll-outs."""

    low_mm: float
    mean_mm: float
    high_mm: float
    share: float


class Models(NamedTuple):
    """What the page tells.

    Attributes:
        rollouts: that the models were learned from.
        colliding: share of them in which an open finger would stand on the part.
        spacing_mm: typical distance of neighbours.
        h1_mm: bandwidth of initial poses.
        h2: bandwidth of final poses, in units of the scatter near by.
        actions: the fixed ones that are free of collision.
        in_collision: how many are not.
        median_mm: error of the sensor in the middle.
        q95_mm: and for 95 % of the roll-outs held out.
        worst_mm: and at worst.
        held_out: their number.
        detectors: with the jaws fully open, and opened anywhere.
        spans: the subspaces, the first one free space.
        notes: about these.
    """

    rollouts: int
    colliding: float
    spacing_mm: float
    h1_mm: float
    h2: float
    actions: list[Action]
    in_collision: int
    median_mm: float
    q95_mm: float
    worst_mm: float
    held_out: int
    detectors: list[Detector]
    spans: list[Span]
    notes: list[str]

    @property
    def worst_ratio(self) -> float | None:
        """The greatest ratio of all actions; None where none has one."""
        return max((action.ratio for action in self.actions if action.ratio is not None), default=None)


def read(path: Path, job_digest: str) -> Models:
    """Reads a file of figures.

    Args:
        path: the file.
        job_digest: of the table's job, hexadecimal: models of another job say nothing about this one.

    Raises:
        InputFileError: it is missing, too large, no such file, or about another job.
    """
    where = str(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputFileError(f"is larger than {MAX_BYTES >> 20} MiB; {WRITE}", where=where)
        told = strict_json.parse(path.read_bytes())
    except OSError as error:
        raise InputFileError(f"cannot be read: {error.strerror}; {WRITE}", where=where) from error
    except ValueError as error:
        raise InputFileError(f"is {error}; {WRITE}", where=where) from error
    try:
        told = told.get("models", told)
        digest = str(told["job_digest"])
        models = _models(told)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputFileError(f"does not tell the quality of models; {WRITE}", where=where) from error
    if digest != job_digest:
        problem = f"is about another job ({digest[:12]}, the table's is {job_digest[:12]}); {WRITE}"
        raise InputFileError(problem, where=where)
    return models


def _models(told: dict[str, Any]) -> Models:
    sensor, collision = told["sensor"], told["collision"]
    total = max(sum(int(part["rollouts"]) for part in told["subspaces"]), 1)
    return Models(
        rollouts=int(told["rollouts"]),
        colliding=_number(told["colliding"]),
        spacing_mm=_number(told["spacing_mm"]),
        h1_mm=_number(told["h1_mm"]),
        h2=_number(told["h2"]),
        actions=[_action(action) for action in told["actions"]],
        in_collision=int(told["actions_in_collision"]),
        median_mm=_number(sensor["median_mm"]),
        q95_mm=_number(sensor["q95_mm"]),
        worst_mm=_number(sensor["worst_mm"]),
        held_out=int(sensor["held_out"]),
        detectors=[
            _detector("fully open", collision["fully_open"]),
            _detector("opened anywhere", collision["any_opening"]),
        ],
        spans=[_span(part, total) for part in told["subspaces"]],
        notes=[str(note) for note in told["notes"]],
    )


def _action(told: dict[str, Any]) -> Action:
    ratio = told["ratio"]
    return Action(
        _number(told["x_mm"]), _number(told["y_mm"]), math.degrees(_number(told["theta_rad"])),
        _number(told["model_mm"]), _number(told["simulator_mm"]), None if ratio is None else _number(ratio),
        _number(told["simulated"]),
    )  # fmt: skip


def _detector(jaws: str, told: dict[str, Any]) -> Detector:
    numbers = int(told["colliding"]), int(told["free"])
    return Detector(jaws, *numbers, _number(told["miss_rate"]), _number(told["false_alarm_rate"]))


def _span(told: dict[str, Any], total: int) -> Span:
    low, mean, high = (_number(told[name]) for name in ("low_mm", "mean_mm", "high_mm"))
    return Span(low, mean, high, int(told["rollouts"]) / total)


def _number(told: Any) -> float:
    """A finite number."""
    value = float(told)
    if not math.isfinite(value):
        raise ValueError(told)
    return value
