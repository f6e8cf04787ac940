"""What-if trials: larger uncertainties and tighter goals, planned in turn."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

FACTORS = (1.25, 1.6, 2.0, 2.5, 3.2)  # a radius is multiplied by each, a distance divided by each
EFFORT = ("--budget", "20s", "--trials", "3000")


class Trial(NamedTuple):
    """A key of the job with values to try in turn, until a plan locates too few parts."""

    key: str
    values: list[float]  # values, each harder to plan for than the one before
    confidence: float  # share of the parts that the job requires to be located

    def command(self, value: float, job: str, folder: str) -> list[str]:
        """The command that plans with a value and writes to a folder, as its words after `squeezetree`."""
        return ["plan", job, "-o", folder, "--vary", f"{self.key}={value:g}", *EFFORT]

    def result(self, value: float, summary: Path) -> dict[str, Any]:
        """Returns the log's entry for a value: the share of parts located, and whether it is enough.

        `summary` is the file with the results of the command that planned with the value.
        """
        (row,) = json.loads(summary.read_text("utf-8"))
        located = row.get("success_rate", 0.0)
        enough = located >= self.confidence
        return {"tried": self.key, "value": value, "located": located, "enough": enough}


def trials_of(job: Path) -> Iterator[Trial]:
    """Yields two trials: of larger radii of the disc in which the part's centre lies, then of tighter goals.

    Yields nothing if the job file lacks the radius of the disc or the distance of the goal.
    """
    stated = tomllib.loads(job.read_text("utf-8")) if job.exists() else {}
    uncertainty, goal = stated.get("uncertainty", {}), stated.get("goal", {})
    if "radius_mm" not in uncertainty or "distance_mm" not in goal:
        return
    radius, distance = uncertainty["radius_mm"], goal["distance_mm"]
    confidence = goal.get("confidence", 0.99)
    larger = [float(f"{radius * by:.2g}") for by in FACTORS]
    nearer = [float(f"{distance / by:.2g}") for by in FACTORS]
    yield Trial("uncertainty.radius_mm", larger, confidence)
    yield Trial("goal.distance_mm", nearer, confidence)
