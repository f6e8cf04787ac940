"""The verdict: does the part lie where its leaf says, as far as a measurement with an error can tell."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from drivers.camera.tag_file import Pose

PASS, FAIL, UNKNOWN = "pass", "fail", "unknown"
COVERAGE = 3.0
"""How many standard deviations a measurement has to be clear of the threshold."""


@dataclass(frozen=True, slots=True)
class Goal:
    """When a part counts as located; the goal of a table, in mm and rad.

    Attributes:
        distance_mm: threshold of d = sqrt(dx^2 + dy^2) + rho dtheta (paper eq. 9).
        rho_mm: what one radian weighs.
        symmetry: rotational order of the part.
        kind: "pose", "modes" (of any of the leaf's poses), "tolerances" or "orientation".
        tolerance: bounds on x, y [mm] and theta [rad], for the last two.
    """

    distance_mm: float
    rho_mm: float
    symmetry: int
    kind: str = "pose"
    tolerance: Pose = (0.0, 0.0, 0.0)


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


def turn(angle_rad: float, symmetry: int) -> float:
    """An angle reduced by the part's symmetry, within half a period of zero."""
    return math.remainder(angle_rad, math.tau / symmetry)


def judge(
    goal: Goal, predicted: Iterable[Pose], measured: Pose, sigma_mm: float, sigma_rad: float
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


def _compare(goal: Goal, pose: Pose, measured: Pose, sigma_mm: float, sigma_rad: float) -> Judgement:
    residual = (measured[0] - pose[0], measured[1] - pose[1], turn(measured[2] - pose[2], goal.symmetry))
    x, y, theta = map(abs, residual)
    if goal.kind in ("pose", "modes"):
        threshold = goal.distance_mm
        distance = math.hypot(x, y) + goal.rho_mm * theta
        error = COVERAGE * math.hypot(sigma_mm, goal.rho_mm * sigma_rad)
    else:
        lengths, angle = goal.tolerance[:2], goal.tolerance[2]
        shares = [(theta / angle, sigma_rad / angle)]
        if goal.kind == "tolerances":
            shares += [(d / length, sigma_mm / length) for d, length in zip((x, y), lengths, strict=True)]
        threshold = 1.0
        distance = max(share for share, _ in shares)
        error = COVERAGE * max(sigma for _, sigma in shares)
    verdict = UNKNOWN
    if distance + error < threshold:
        verdict = PASS
    elif distance - error >= threshold:
        verdict = FAIL
    return Judgement(verdict, distance, error, threshold, residual)
