"""The actions of a plan: placements at which the open hand comes down for a squeeze."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric, Mode
from planner.frames import to_hand, wrap
from planner.job.model import Job
from planner.search.proposals import Proposals, along, placed, proposals_of

MAIN_MODES = 2
LEAST_MODE = 0.1
"""Share of the belief below which a mode other than the first gets no placements."""
ASIDE = (0.25, 0.5)
"""Shifts of the first squeeze along the fingers, in finger lengths."""
ALONG = np.radians(15.0)
"""Difference from a mode's angle up to which a pose lies along it."""
ALIKE = 1e-3  # distance below which placements are equal [mm, mm, rad]

Key: TypeAlias = tuple[tuple[int, ...], ...]


class AlongSides(NamedTuple):
    """Hand placements along a part's sides, computed from a belief; empty where the job proposes none.

    Attributes:
        about_modes: (k, 3) placements about the main modes of the belief [mm, mm, rad].
        about_middles: (k, 3) the same placements, moved to the middle of each mode's poses, where open jaws
            clear more particles.
    """

    about_modes: Array
    about_middles: Array


@dataclass(frozen=True, slots=True, eq=False)
class ActionSet:
    """The hand placements among which every node of a plan chooses.

    Attributes:
        placements: (k, 3) fixed placements, which are poses of the hand frame in the world [mm, mm, rad].
        proposals: placements relative to a belief, for each hypothesis; empty for none.
        area: ((x_min, y_min), (x_max, y_max)) in which the hand may be placed.
        first: (m, 3) placements of the first squeeze; None: the same as those of all other squeezes.
    """

    placements: Array
    proposals: tuple[Proposals, ...]
    area: Array
    first: Array | None = None

    def followed(self, poses: Array) -> Array:
        """Placements (k, 3) for pushed parts at poses (n, 3): the fixed ones, and some at the parts' middle.

        At the middle, which is the mean position of the parts, there is one placement for each fixed angle.
        """
        angles = np.unique(self.placements[:, 2])
        about = np.column_stack([np.tile(poses[:, :2].mean(axis=0), (len(angles), 1)), angles])
        return np.concatenate([self.placements, about])

    def along_sides(self, states: Array, metric: Metric) -> AlongSides:
        """The placements along the sides of the part for states (n, 3 or 4) [mm, mm, rad, hypothesis]."""
        about = middle = self.placements[:0]
        modes = metric.main_modes(states, MAIN_MODES, LEAST_MODE) if self.proposals else []
        for mode in modes:
            relative = self.proposals[mode.hypothesis[0]].relative
            about = np.concatenate([about, placed(relative, mode.pose)])
            middle = np.concatenate([middle, placed(relative, middle_of(states, mode))])
        return AlongSides(about, middle)

    def within(self, placements: Array) -> Array:
        """The placements whose hand centre lies in the area."""
        inside = (placements[:, :2] >= self.area[0]) & (placements[:, :2] <= self.area[1])
        return np.asarray(placements[inside.all(axis=1)])


def middle_of(states: Array, mode: Mode) -> Array:
    """A mode's pose (3,), moved to the middle of the states that lie at its angle or half a turn from it.

    Returns the mode's pose itself if none of the states (n, 3 or 4) has such an angle: a mode may lie between
    states, or be the symmetric pose of all of them.
    """
    angle = mode.pose[2]
    along = states[np.abs(wrap(states[:, 2] - angle, 2)) < ALONG, :2]
    if not len(along):
        return np.array(mode.pose)
    return np.array([*0.5 * (along.min(axis=0) + along.max(axis=0)), angle])


def actions_of(job: Job) -> ActionSet:
    """The actions of a job: every angle at every centre, in order, and its proposals."""
    angles = np.radians(np.array(job.actions.angles_deg))
    centers = job.actions.centers_mm
    grid = np.array([(x, y, angle) for x, y in centers for angle in angles], dtype=np.float64)
    actions = ActionSet(grid, proposals_of(job), np.array(job.cell.work_area_mm))
    return replace(actions, first=_first(job, actions)) if turnable(job) else actions


def turnable(job: Job) -> bool:
    """Whether parts lie at any angle, so that turning a whole plan about the origin changes nothing."""
    return math.isclose(job.uncertainty.orientation_halfwidth_deg, 180.0)


def _first(job: Job, actions: ActionSet) -> Array:
    """Returns the placements of the first squeeze: fixed and shifted ones, no two of them equivalent.

    The fixed ones are also shifted along the fingers if the job has one centre and proposes placements.
    """
    shifts = (0.0, *ASIDE) if actions.proposals and len(job.actions.centers_mm) == 1 else (0.0,)
    beside = [along(actions.placements, share * job.gripper.finger_length_mm) for share in shifts]
    return inequivalent(actions.within(np.concatenate(beside)), actions.placements[:0], job)


def inequivalent(placements: Array, common: Array, job: Job) -> Array:
    """The placements (k, 3), without placements that a turn about the origin maps to an earlier one.

    Where parts lie in a disc about the origin at any angle, a turn of the whole plan changes nothing. The
    placements `common` (m, 3) are available to every squeeze of the plan; a turn counts only if it maps them
    onto themselves. Placements about modes need no check, since they turn with the parts.
    """
    # For fingers that move alike, half a turn of the hand changes nothing either.
    alike = job.gripper.upper_finger_share == 0.5
    seen: dict[tuple[Key, Key], Array] = {}
    for placement in placements:
        turns = [placement[2], placement[2] + math.pi] if turnable(job) else [0.0]
        keys = [(_key(placement[None], turn, alike), _key(common, turn, alike)) for turn in turns]
        if not any(key in seen for key in keys):
            seen[keys[0]] = placement
    return np.array(list(seen.values()))


def _key(placements: Array, turn: float, alike: bool) -> Key:
    """Key of a set of placements (k, 3) in a frame turned by `turn` [rad]; equal sets have equal keys.

    With `alike`, half a turn of the hand makes no difference.
    """
    placements = to_hand(placements, np.array([0.0, 0.0, turn]))
    period = math.pi if alike else 2.0 * math.pi
    angle = np.round(np.mod(placements[:, 2] + 0.5 * ALIKE, period) / ALIKE - 0.5)
    rows = np.column_stack([np.round(placements[:, :2] / ALIKE), angle]).astype(np.int64)
    return tuple(sorted({tuple(row) for row in rows.tolist()}))
