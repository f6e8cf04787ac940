"""Choices about a squeeze after its placement: the opening, and where the part is released.

Neither affects where a squeeze ends in the hand frame: from any opening the fingers meet the part at the same
place, since the jaws are one linkage.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.observation import Encoder, encoder_of
from planner.belief.particles import Belief
from planner.belief.transition import Outcomes, read_as
from planner.frames import to_hand
from planner.job.model import Job
from planner.mechanics.clearance import (
    STANDS_ON,
    Jaws,
    classify_contact,
    first_contact_mm,
    jaws_of,
    least_clearance,
)
from planner.mechanics.traits import by_hypothesis
from runtime.table import HELD_UM

CONTACT_MARGIN_MM = 2.0
"""Margin of the first contact beyond the particles of a belief, since they are only samples."""
SHARE_DECIMALS = 2
"""Rounding of shares of the closing, so that parts with similar ones are processed together."""
HERE = np.zeros(3)
SPARE_MM = 2.0
"""Least excess of an opening, smaller than the full one, over the first contact."""
LEAST_PARTICLES = 400
"""Number of particles below which the first contact is too uncertain for any but the full opening."""
HELD_MM = HELD_UM / 1e3
"""Expected width below which a branch holds no part, and nothing is dragged."""


class Opening(NamedTuple):
    """The jaws before a squeeze."""

    opening_mm: float
    clearance_mm: float  # least distance between the open fingers and the belief
    contact_mm: float  # greatest width at which closing jaws may meet it


@dataclass(frozen=True, slots=True, eq=False)
class Handling:
    """The choices of a job.

    Attributes:
        outlines: (N, 2) of the part [mm], for each hypothesis.
        jaws: of the gripper, fully open.
        alike: whether the fingers move alike; otherwise the opening decides which one touches first.
        area: ((x_min, y_min), (x_max, y_max)) that the hand may be placed in.
        encoder: turns the branches' counts into widths.
    """

    outlines: tuple[Array, ...]
    jaws: Jaws
    alike: bool
    area: Array
    encoder: Encoder

    def opening(self, belief: Belief, placement: Array, *, pushed: bool = False) -> Opening:
        """The least opening `SPARE_MM` wider than the first contact.

        The full opening for fingers that do not move alike, for parts that were `pushed` before, and for few
        particles: their pose is less certain.
        """
        contact_mm = self.contact_mm(belief, placement)
        uncertain = pushed or len(belief) < LEAST_PARTICLES
        full_mm = self.jaws.opening_mm
        free = self.alike and not uncertain
        opening = min(contact_mm + SPARE_MM, full_mm) if free else full_mm
        clearance_mm = max(self._clearance(opening, belief, placement), 0.0)
        return Opening(opening, clearance_mm, contact_mm)

    def contact_mm(self, belief: Belief, placement: Array) -> float:
        """The greatest width at which closing jaws may meet a part of a belief, given its traits."""
        traits, hand = belief.traits, to_hand(belief.poses, placement)
        hand[:, 1] -= traits["across_mm"]
        part, widths = traits["hypothesis"], list[float]()
        shares = np.round(
            np.clip(self.jaws.upper_share + traits["share"], 0.0, 1.0), SHARE_DECIMALS
        )
        for k, share in {*zip(part.tolist(), shares.tolist(), strict=True)}:
            rows = (part == k) & (shares == share)
            width_mm = first_contact_mm(
                self.outlines[k], self.jaws, hand[rows], HERE, (share, share)
            )
            widths.append(float(read_as(np.asarray(width_mm), traits[rows]).max()))
        return max(widths) + CONTACT_MARGIN_MM

    def clear(self, belief: Belief, placement: Array) -> Belief:
        """The particles clear of both open fingers; on the others the arm stops."""
        verdict, poses = np.empty(len(belief), np.int64), to_hand(belief.poses, placement)
        for k, rows in by_hypothesis(belief.traits):
            verdict[rows] = classify_contact(self.outlines[k], self.jaws, poses[rows])
        return belief[verdict != STANDS_ON]

    def release(self, outcomes: Outcomes) -> Array | None:
        """Place of release: the area's middle, if a held part may lie where the hand cannot follow it.

        The paper's cell does the same near the edge of its table (VII.A).

        Args:
            outcomes: of the squeeze.

        Returns:
            (2,) hand centre in the world; None: the hand stays.
        """
        reach = max(float(np.max(np.hypot(*outline.T))) for outline in self.outlines)
        low, high = self.area[0] + reach, self.area[1] - reach
        held = [
            b.poses
            for b, w in zip(outcomes.beliefs, self._widths(outcomes), strict=True)
            if w >= HELD_MM
        ]
        if not held or bool(np.any(low >= high)):
            return None
        centres = np.concatenate(held)[:, :2]
        if bool(np.all((centres >= low) & (centres <= high))):
            return None
        return np.asarray(0.5 * (self.area[0] + self.area[1]))

    def released(self, placement: Array, release: Array | None, outcomes: Outcomes) -> list[Belief]:
        """The beliefs after the jaws have opened: held parts have moved along with the hand."""
        if release is None:
            return outcomes.beliefs
        drag = np.array([*(release - placement[:2]), 0.0])
        return [
            replace(belief, poses=belief.poses + drag) if width >= HELD_MM else belief
            for belief, width in zip(outcomes.beliefs, self._widths(outcomes), strict=True)
        ]

    def _clearance(self, opening: float, belief: Belief, placement: Array) -> float:
        jaws = self.jaws._replace(opening_mm=opening)
        return min(
            least_clearance(self.outlines[k], jaws, belief.poses[rows], placement)
            for k, rows in by_hypothesis(belief.traits)
        )

    def _widths(self, outcomes: Outcomes) -> Array:
        return self.encoder.width_mm(outcomes.clusters.mean)


def handling_of(job: Job) -> Handling:
    """The choices that a job allows."""
    return Handling(
        outlines=tuple(alone.part.outline_mm for alone in job.alone),
        jaws=jaws_of(job.gripper),
        alike=job.gripper.upper_finger_share == 0.5,
        area=np.array(job.cell.work_area_mm),
        encoder=encoder_of(job),
    )
