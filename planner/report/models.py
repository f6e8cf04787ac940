"""What `plan-compile --models-report` wrote beside its picture, or printed with --json, read for a page."""

import math
from pathlib import Path
from typing import Any, TypeAlias

from planner.errors import InputFileError
from runtime.shell import strict_json

MAX_BYTES = 16 << 20
WRITE = "have plan-compile --models-report write it"

Models: TypeAlias = dict[str, Any]  # the figures of `planner.cli.models_report.figures` that a page shows


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
            "x_mm": _number, "y_mm": _number, "theta_rad": _number, "model_mm": _number,
            "simulator_mm": _number, "simulated": _number,
            "ratio": lambda told: None if told is None else _number(told),
        }
    ],
    "actions_in_collision": int,
    "sensor": {"median_mm": _number, "q95_mm": _number, "worst_mm": _number, "held_out": int},
    "collision": {"colliding": int, "free": int, "miss_rate": _number, "false_alarm_rate": _number},
    "subspaces": [{"low_mm": _number, "mean_mm": _number, "high_mm": _number, "rollouts": int}],
    "notes": [str],
}  # fmt: skip


def read(path: Path, job_digest: str) -> Models:
    """Reads a file of figures about the job of this digest (hexadecimal).

    Raises:
        InputFileError: it is missing, too large, no such file, or about another job.
    """

    def refused(problem: str) -> InputFileError:
        return InputFileError(f"{problem}; {WRITE}", where=str(path))

    told = strict_json.load(path, refused, MAX_BYTES)
    try:
        models: Models = _shaped(told.get("models", told), SHAPE)
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
