"""Hand placements relative to the belief: they distinguish poses that a fixed set of squeezes cannot.

Centred squeezes leave a part without half-turn symmetry in two poses that no further centred squeeze can
tell apart. Near a tip of the part, or over one of its arms, the jaws close to another width than over the
opposite end. Placements are therefore computed from a node's belief, too: the hand parallel to the part's
stable sides, shifted along the fingers so that they cover all of it or only one end; grasp poses scattered
about the part; and variants of the best of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from planner.arrays import Array
from planner.belief.particles import RATIO
from planner.frames import to_world, wrap
from planner.job.model import Job
from planner.part.outline import reach

ANGLES_DEG = np.arange(0.0, 180.0, 1.0)
MOST_ANGLES = 4
APART_DEG = 12.0
COVERED = (0.15, 0.35)
"""Shares of the part's length, from either end, that an off-centre finger covers."""
SCATTERED = 1024
"""Number of grasp poses scattered about a part; the search uses a prefix of them."""
ALONG, ACROSS = 0.8, 0.3
"""Range of scattered grasp poses about the part, in its reaches: along, beyond half a finger; across."""
VARIED = ((3.0, np.radians(8.0)), (1.0, np.radians(3.0)))
"""Standard deviations of variants about a good placement, in each round [mm, rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """Placements worth trying about a believed pose.

    Attributes:
        relative: (m, 3) the hand in the part's frame [mm, mm, rad].
        scattered: (n, 3) further poses of the hand, spread evenly about the part; each prefix is spread
            evenly, too.
    """

    relative: Array
    scattered: Array


def proposals_of(job: Job) -> tuple[Proposals, ...]:
    """The proposals for each of a job's parts; empty where the job disables them."""
    return () if job.actions.proposals == "none" else tuple(map(_of_part, job.alone))


def _of_part(job: Job) -> Proposals:
    outline, half, rows = job.part.outline_mm, 0.5 * job.gripper.finger_length_mm, []
    for angle in stable_angles(outline):
        along = outline @ np.array([np.cos(angle), np.sin(angle)])
        low, high = float(along.min()), float(along.max())
        shifts = [0.0]
        for share in COVERED:
            shifts.append(low + share * (high - low) - half)
            if job.part.symmetry % 2:  # if the symmetry has half a turn, both ends are alike
                shifts.append(high - share * (high - low) + half)
        rows += [(shift * np.cos(angle), shift * np.sin(angle), angle) for shift in shifts]
    return Proposals(np.array(rows), hands_about(reach(outline), half, SCATTERED))


def hands_about(reach_mm: float, half_mm: float, n: int) -> Array:
    """Grasp poses scattered about a part, at all angles and at shifts where the fingers can still touch it.

    Args:
        reach_mm: largest distance of the outline from the part's origin.
        half_mm: half the length of the fingers.
        n: number of grasp poses; a larger n adds grasp poses and keeps the earlier ones.

    Returns:
        (n, 3) the hand in the part's frame [mm, mm, rad].
    """
    turn, along, across = np.outer(RATIO ** -np.arange(1.0, 4.0), np.arange(1, n + 1)) % 1.0
    angle = np.pi * turn
    shift = (2.0 * along - 1.0) * (half_mm + ALONG * reach_mm)
    aside = (2.0 * across - 1.0) * ACROSS * reach_mm
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([shift * c - aside * s, shift * s + aside * c, angle], axis=-1)


def varied(placements: Array, n: int, spread: tuple[float, float], rng: Generator) -> Array:
    """Returns n variants of each of the placements (k, 3), normally distributed about it: (k n, 3).

    Args:
        placements: good ones, the hand in the world [mm, mm, rad].
        n: number of variants of each placement.
        spread: standard deviations of x and y [mm], and of the angle [rad].
        rng: source of randomness.
    """
    deviation = np.array([spread[0], spread[0], spread[1]])
    about = np.repeat(placements, n, axis=0)
    return np.asarray(about + deviation * rng.standard_normal(about.shape))


def placed(relative: Array, pose: Array) -> Array:
    """Transforms grasp poses (m, 3) from a part's frame to the world, for the part at a pose (3,)."""
    hands = to_world(relative, pose)
    hands[:, 2] = wrap(hands[:, 2])
    return hands


def along(placements: Array, shift_mm: float) -> Array:
    """Placements (k, 3) of the hand, each shifted along its fingers by `shift_mm`."""
    x, y, angle = placements.T
    return np.stack([x + shift_mm * np.cos(angle), y + shift_mm * np.sin(angle), angle], axis=-1)


def stable_angles(outline: Array) -> Array:
    """Hand angles in the part's frame at which a frictionless squeeze comes to rest [rad].

    The width of the outline between parallel jaws is least there (Goldberg 1993); the narrowest come first.
    The direction perpendicular to the smallest of these angles comes last. Angles near an earlier one are
    left out.

    Args:
        outline: (N, 2) vertices [mm].

    Returns:
        (k,) angles of the fingers, in [0, pi), at most `MOST_ANGLES`.
    """
    angles = np.radians(ANGLES_DEG)
    across = outline @ np.stack([-np.sin(angles), np.cos(angles)])
    width = np.ptp(across, axis=0)
    rest = (width <= np.roll(width, 1)) & (width <= np.roll(width, -1))
    narrow, results = angles[rest][np.argsort(width[rest], kind="stable")], list[float]()
    for angle in [*narrow, *(angles[rest][:1] + np.pi / 2)]:
        apart = [abs(float(wrap(np.asarray(angle - other), 2))) for other in results]
        if len(results) < MOST_ANGLES and min(apart, default=np.inf) > np.radians(APART_DEG):
            results.append(float(angle) % np.pi)
    return np.array(results)
