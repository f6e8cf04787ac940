"""The verdict: does the part lie where its leaf says, as far as a measurement with an error can tell."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from drivers.camera.vision.tag_file import Pose
from runtime.table import GoalSpec, distance, residual, threshold

PASS, FAIL, UNKNOWN = "pass", "fail", "unknown"
COVERAGE = 3.0
"""How many standard deviations a measurement has to be clear of the threshold."""


class Judgement(NamedTuple):
    """How a measurement compares.

    Attributes:
        verdict: "pass", "fail" or "unknown".
        distance: eq. 9 in mm; for tolerances the largest deviation in units of its own.
        error: `COVERAGE` standard deviations of it.
        threshold: what it has to stay below.
        residual: measured less predicted: mm, mm, rad under the symmetry.
    """

    verdict: str
    distance: float
    error: float
    threshold: float
    residual: Pose


def judge(
    goal: GoalSpec, predicted: Iterable[Pose], measured: Pose, sigma_mm: float, sigma_rad: float
) -> Judgement:
    """Compare a measured pose with the predicted ones; the nearest counts.

    Args:
        goal: of the table.
        predicted: the leaf's pose, and others it allows.
        measured: by the camera.
        sigma_mm: standard deviation of the measured place, in each direction.
        sigma_rad: standard deviation of the measured angle.
    """
    return min(
        (_compare(goal, pose, measured, sigma_mm, sigma_rad) for pose in predicted),
        key=lambda judged: judged.distance,
    )


def _compare(goal: GoalSpec, pose: Pose, measured: Pose, sigma_mm: float, sigma_rad: float) -> Judgement:
    off, bound = distance(goal, pose, measured), threshold(goal)
    if goal.kind in ("pose", "modes"):
        sigma = math.hypot(sigma_mm, goal.rho_um / 1e3 * sigma_rad)
    else:
        x_um, y_um, theta_urad = goal.tolerance
        shift = sigma_mm / (min(x_um, y_um) / 1e3) if goal.kind == "tolerances" else 0.0
        sigma = max(shift, sigma_rad / (theta_urad / 1e6))
    error, verdict = COVERAGE * sigma, UNKNOWN
    if off + error < bound:
        verdict = PASS
    elif off - error >= bound:
        verdict = FAIL
    return Judgement(verdict, off, error, bound, residual(goal, pose, measured))
