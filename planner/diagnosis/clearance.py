"""Explains why a job has no first squeeze, and how much clearance the open fingers lack."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.metric import metric_of
from planner.job.model import Job
from planner.mechanics.clearance import free_placements, jaws_of
from planner.part.outline import reach
from planner.search.actions import actions_of
from planner.search.ranking import LEAST_CLEARANCE_MM

DIRECTIONS = 24  # directions of a part's centre from the middle of its disc
RINGS = 32  # rings of equal area, at whose outer edges the centres of parts lie
STEP_DEG = 3.0  # largest step between the angles of a part
TURNS = 12  # angles of the hand at the middle of the disc, besides the job's placements
HALVINGS = 12  # number of halvings of the interval in which an opening or a radius is sought


class Shortage(NamedTuple):
    """What a job lacks for a first squeeze without collision: a wider opening, or a smaller disc.

    Attributes:
        missing_mm: opening that the jaws lack; 0 if they open wide enough.
        radius_mm: largest radius of the disc of initial positions for which the jaws open wide enough;
            None: no radius is small enough.
    """

    missing_mm: float
    radius_mm: float | None

    def line(self) -> str:
        """States how much opening is missing and which radius would do, for people."""
        short = f"the jaws open {self.missing_mm:.2g} mm too little"
        if self.radius_mm is None:
            return f"{short}, even for a part in the middle"
        return f"{short}; radius_mm = {self.radius_mm:g} or less would do"


def shortage(job: Job) -> Shortage | None:
    """Finds the least opening, or else the largest disc, with which a first squeeze is free of collision.

    Returns:
        The missing opening and the radius; None if some placement is free of collision already.
    """
    opening, radius = job.gripper.opening_mm, job.uncertainty.radius_mm
    if _is_free(job, opening, radius):
        return None
    farthest = radius + max(reach(alone.part.outline_mm) for alone in job.alone)
    enough = 2.0 * (farthest + LEAST_CLEARANCE_MM)  # at the middle of the disc
    wider = _least(lambda mm: _is_free(job, mm, radius), opening, enough)
    if not _is_free(job, opening, 0.0):
        return Shortage(wider - opening, None)
    less = _least(lambda mm: _is_free(job, opening, radius - mm), 0.0, radius)
    return Shortage(wider - opening, math.floor(10.0 * (radius - less)) / 10.0 or None)


def _least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Finds by bisection the least number for which `holds` is true.

    The condition must be true at `high` and false at `low`.
    """
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _is_free(job: Job, opening_mm: float, radius_mm: float) -> bool:
    """Whether a hand open to `opening_mm` has a placement that clears the part wherever it may lie.

    The part may lie anywhere in a disc of `radius_mm`, at the angles of the job. The hand need not clear it
    at the share `crash_share` of these poses, which the goal of the job allows.
    """
    jaws = jaws_of(job.gripper)._replace(opening_mm=opening_mm)
    poses = _poses(radius_mm, job.uncertainty.orientation_halfwidth_deg)
    turned = np.zeros((TURNS, 3))
    turned[:, 2] = np.arange(TURNS) * math.pi / TURNS
    placements = np.concatenate([actions_of(job).placements, turned])
    share = job.goal.crash_share
    least_mm = 0.0 if share else LEAST_CLEARANCE_MM
    outlines = [alone.part.outline_mm for alone in job.alone]
    free = [
        free_placements(outline, jaws, poses, placements, least_mm, share) for outline in outlines
    ]
    return bool(np.all(free, axis=0).any())


def _is_met(job: Job) -> bool:
    """Whether the goal of a job is met before any squeeze: one pose has all initial poses within the goal.

    False if the job has several hypotheses.
    """
    poses = _poses(job.uncertainty.radius_mm, job.uncertainty.orientation_halfwidth_deg)
    return len(job.alone) == 1 and metric_of(job).mode(poses).ratio == 1.0


def _poses(radius_mm: float, halfwidth_deg: float) -> Array:
    """Poses (n, 3) that cover a disc and an interval of angles, edges included [mm, mm, rad]."""
    radii = radius_mm * np.sqrt(np.arange(1, RINGS + 1) / RINGS)
    around = np.arange(DIRECTIONS) * math.tau / DIRECTIONS
    count = 1 + 2 * math.ceil(halfwidth_deg / STEP_DEG)
    angles = np.radians(np.linspace(-halfwidth_deg, halfwidth_deg, count))
    r, phi, theta = (axis.ravel() for axis in np.meshgrid(radii, around, angles))
    return np.column_stack([r * np.cos(phi), r * np.sin(phi), theta])


def no_first_squeeze(job: Job) -> str:
    """States why a job has no first squeeze, and the remedy, as a sentence without its full stop."""
    more = "actions" if job.actions.pushes else "actions or pushes"
    if _is_met(job):
        done = "the goal is met before any squeeze"
        return f"{done}; nothing is left to locate, unless it asks for less"
    lacking = shortage(job)
    if lacking is None:
        return f"no first squeeze gains anything; add {more}, or reduce the uncertainty"
    way = "take" if lacking.radius_mm is None else "or take"
    return f"no first squeeze is free of collision: {lacking.line()}; {way} a wider gripper, or add {more}"
