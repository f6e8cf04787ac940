"""The region that roll-outs start from: a disc of part centres about the hand, at any angle, cut into rings.

Every ring is filled on its own and with one density, so that a larger disc contains the smaller ones, point
by point. Where no finger can reach the part a squeeze changes nothing, and needs no roll-out.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array, BoolArray
from planner.job import Job
from planner.kernel import kernel
from planner.mechanics.clearance import blocked
from planner.mechanics.contacts import place

RING_MM = 5.0
"""Width of a ring."""
FACTOR = 3.0
"""Radius of the region in radii of the job's uncertainty (paper, VII)."""


def region_radius(job: Job, factor: float = FACTOR) -> float:
    """Radius of the disc that a job's roll-outs start from [mm].

    At least one ring, and at most as far as the fingers reach the part.
    """
    gripper = job.gripper
    jaws = np.array([gripper.opening_mm, gripper.finger_length_mm, gripper.finger_width_mm])
    reach = farthest(job.part.outline_mm, jaws)
    return max(RING_MM, min(factor * job.uncertainty.radius_mm, reach))


def farthest(outline: Array, jaws: Array) -> float:
    """Distance of the part's centre from the hand's beyond which no finger touches it, at any angle [mm].

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
    """
    half_x, half_y = _swept(jaws)
    return math.hypot(half_x, half_y) + _extent(outline)


def within_reach(outline: Array, jaws: Array, poses: Array) -> BoolArray:
    """Where closing fingers could touch the part, were it turned the right way.

    Elsewhere a squeeze leaves the part exactly where it is.

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
        poses: (n, 3) in the hand frame.

    Returns:
        (n,) True where the circle about the part meets the box that the fingers sweep.
    """
    half_x, half_y = _swept(jaws)
    dx = np.maximum(np.abs(poses[:, 0]) - half_x, 0.0)
    dy = np.maximum(np.abs(poses[:, 1]) - half_y, 0.0)
    return np.asarray(np.hypot(dx, dy) <= _extent(outline))


def stands_on(outline: Array, jaws: Array, poses: Array) -> BoolArray:
    """Where an open finger would come down on the part.

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
        poses: (n, 3) in the hand frame.

    Returns:
        (n,) True where the part and a finger's box share any area.
    """
    hits = np.zeros(len(poses), np.bool_)
    n = len(outline)
    _blocked_many(
        outline, np.ascontiguousarray(poses), jaws[0], 0.5 * jaws[1], jaws[2], np.empty((n, 2)), hits
    )
    return hits


def ring_counts(radius_mm: float, count: int) -> list[int]:
    """How many starts each ring gets, from the innermost on, for `count` of them in the disc.

    The last ring is filled as a whole, whether or not the disc ends within it.

    Args:
        radius_mm: radius of the disc, above 0.
        count: starts in the disc, at least 1.
    """
    density = count / (math.pi * radius_mm**2)
    rings = math.ceil(radius_mm / RING_MM)
    return [round(density * math.pi * RING_MM**2 * (2 * ring + 1)) for ring in range(rings)]


def starts(ring: int, n: int, rng: np.random.Generator) -> Array:
    """Draw (n, 3) poses: centres uniform in a ring, angles uniform [mm, mm, rad]."""
    radius = RING_MM * np.sqrt(rng.uniform(ring**2, (ring + 1) ** 2, n))
    bearing = rng.uniform(-math.pi, math.pi, n)
    return np.stack(
        [radius * np.cos(bearing), radius * np.sin(bearing), rng.uniform(-math.pi, math.pi, n)], axis=1
    )


def _swept(jaws: Array) -> tuple[float, float]:
    """Half the extents of the box that open fingers lie in, and never leave."""
    return 0.5 * float(jaws[1]), 0.5 * float(jaws[0]) + float(jaws[2])


def _extent(outline: Array) -> float:
    return float(np.max(np.hypot(outline[:, 0], outline[:, 1])))


@kernel
def _blocked_many(outline: Array, poses: Array, opening: float, h: float, thickness: float, points: Array,
                  hits: BoolArray) -> None:  # fmt: skip
    """`clearance.blocked` by either finger, for every pose; `hits` in place."""
    n = outline.shape[0]
    listed = np.arange(n)
    for k in range(poses.shape[0]):
        place(outline, poses[k], points, listed, n)
        hits[k] = blocked(points, 1, 0.5 * opening, h, thickness) or blocked(
            points, -1, -0.5 * opening, h, thickness
        )
