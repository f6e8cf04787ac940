"""Hand placements relative to the belief: they distinguish poses that a fixed set of squeezes cannot.

Centred squeezes leave a part without half-turn symmetry in two poses that no further centred squeeze can tell
apart. Near a tip of the part, or over one of its arms, the jaws close to another width than over the
opposite end. Placements are therefore computed from a node's own belief, too: the hand parallel to the
part's stable sides, shifted along the fingers so that they cover all of it or only one end. Where none of
these gains anything, hands in all directions about the part are tried.
"""

from dataclasses import dataclass, field

import numpy as np

from planner.arrays import Array
from planner.frames import wrap
from planner.job.model import Job
from planner.part.outline import reach

ANGLES_DEG = np.arange(0.0, 180.0, 1.0)
MOST_ANGLES = 4
APART_DEG = 12.0
COVERED = (0.15, 0.35)
"""Shares of the part's length, from either end, that an off-centre finger covers."""
ASIDE = (-0.5, 0.5)
"""Shifts of the fixed placements, in lengths of the finger: one half of a part at their middle sticks out.
Parts whose halves are alike have none: they gain little, and take three times as long to plan."""
TURNS = 12
"""Directions of the hands all about the part, half a turn together."""
ENDS = (-0.6, 0.0, 0.6)
"""Where on the part their fingers end, in its reaches."""
TURNS_DEG = (-10.0, 10.0)
SHIFTS_MM = (-3.0, 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class Proposals:
    """Placements worth trying about a believed pose.

    Attributes:
        relative: (m, 3) the hand in the part's frame [mm, mm, rad].
        shifts_mm: of the fixed placements along their fingers.
        wide: (n, 3) more of the former, all about the part: where nothing else tells two poses apart.
    """

    relative: Array
    shifts_mm: tuple[float, ...] = ()
    wide: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def about(self, pose: Array, *, wide: bool = False) -> Array:
        """The placements (m, 3) in the world for a part believed at a pose (3,)."""
        return placed(self.wide if wide else self.relative, pose)

    def beside(self, placements: Array) -> Array:
        """Placements (k, 3) in the world, each shifted along its fingers: (s k, 3)."""
        return np.concatenate([placements[:0], *(along(placements, shift) for shift in self.shifts_mm)])


def proposals_of(job: Job) -> tuple[Proposals, ...]:
    """The proposals for each of a job's parts and its fingers; none where the job wants none."""
    return () if job.actions.proposals == "none" else tuple(map(_of_part, job.alone))


def _of_part(job: Job) -> Proposals:
    outline = job.part.outline_mm
    half = 0.5 * job.gripper.finger_length_mm
    rows = []
    for angle in stable_angles(outline):
        along = outline @ np.array([np.cos(angle), np.sin(angle)])
        low, high = float(along.min()), float(along.max())
        shifts = [0.0]
        for share in COVERED:
            shifts.append(low + share * (high - low) - half)
            if job.part.symmetry % 2:  # half a turn makes the other end the same
                shifts.append(high - share * (high - low) + half)
        rows += [(shift * np.cos(angle), shift * np.sin(angle), angle) for shift in shifts]
    shares = ASIDE if job.part.symmetry % 2 else ()
    beside = tuple(share * job.gripper.finger_length_mm for share in shares)
    return Proposals(np.array(rows), beside, around(reach(outline), half))


def around(reach_mm: float, half_mm: float) -> Array:
    """Hands all about a part: in every direction, with their middle or one end of the fingers over the part.

    Args:
        reach_mm: of the part about its origin.
        half_mm: half the length of the fingers.

    Returns:
        (84, 3) the hand in the part's frame [mm, mm, rad].
    """
    ends = half_mm + reach_mm * np.array(ENDS)
    shift, angle = np.meshgrid([*-ends, 0.0, *ends], np.arange(TURNS) * np.pi / TURNS)
    return np.stack([shift * np.cos(angle), shift * np.sin(angle), angle], axis=-1).reshape(-1, 3)


def placed(relative: Array, pose: Array) -> Array:
    """Hands (m, 3) in a part's frame, in the world for the part at a pose (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y, angle = relative.T
    return np.stack(
        [pose[0] + c * x - s * y, pose[1] + s * x + c * y, wrap(angle + pose[2])],
        axis=-1,
    )


def along(placements: Array, shift_mm: float) -> Array:
    """Placements (k, 3) of the hand, each shifted along its fingers."""
    x, y, angle = placements.T
    return np.stack([x + shift_mm * np.cos(angle), y + shift_mm * np.sin(angle), angle], axis=-1)


def stable_angles(outline: Array) -> Array:
    """Hand angles in the part's frame at which a frictionless squeeze comes to rest [rad].

    The width of the outline between parallel jaws is least there (Goldberg 1993); the narrowest come first.
    Where there is only one, the direction across it is added.

    Args:
        outline: (N, 2) vertices [mm].

    Returns:
        (k,) angles of the fingers, in [0, pi), at most `MOST_ANGLES`.
    """
    angles = np.radians(ANGLES_DEG)
    across = outline @ np.stack([-np.sin(angles), np.cos(angles)])
    width = np.ptp(across, axis=0)
    rest = (width <= np.roll(width, 1)) & (width <= np.roll(width, -1))
    found: list[float] = []
    for angle in [*angles[rest][np.argsort(width[rest], kind="stable")], *(angles[rest][:1] + np.pi / 2)]:
        apart = [abs(float(wrap(np.asarray(angle - other), 2))) for other in found]
        if len(found) < MOST_ANGLES and min(apart, default=np.inf) > np.radians(APART_DEG):
            found.append(float(angle) % np.pi)
    return np.array(found)


def refined(placement: Array) -> Array:
    """Placements (k, 3) in the world near one that looks good: turned, and shifted along the fingers."""
    turned = [placement + np.array([0.0, 0.0, np.radians(turn)]) for turn in TURNS_DEG]
    return np.concatenate([turned, *(along(placement[None], shift) for shift in SHIFTS_MM)])
