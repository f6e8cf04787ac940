"""Choices about a squeeze after its placement: the opening, and where the part is released.

Neither affects where a squeeze ends in the hand frame: from any opening the fingers meet the part at the same
place, since the jaws are one linkage.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.belief.particles import Belief
from planner.belief.transition import Outcomes, read_as
from planner.frames import to_hand
from planner.job.model import Job
from planner.mechanics.clearance import (
    STANDS_ON,
    classify_contact,
    first_contacts_mm,
    jaws_of,
    least_clearance,
)
from planner.mechanics.traits import by_hypothesis
from planner.part.outline import reach
from runtime.table import HELD_UM

CONTACT_MARGIN_MM = 2.0
"""Margin of the first contact beyond the particles of a belief, since they are only samples."""
SHARE_DECIMALS = 2
"""Rounding of shares of the closing: all parts of one share count with the widest contact among them."""
SPARE_MM = 2.0
"""Excess of an opening, unless it is the full one, over the width of the first contact."""
LEAST_PARTICLES = 400
"""Number of particles below which the first contact is too uncertain for any but the full opening."""
HELD_MM = HELD_UM / 1e3
"""Expected width below which a branch holds no part, and nothing is dragged."""


class Opening(NamedTuple):
    """The opening of the jaws before a squeeze, and the room that it leaves."""

    opening_mm: float
    clearance_mm: float  # least distance between the open fingers and the belief
    contact_mm: float  # greatest width at which closing jaws may meet a part of the belief


class Handling:
    """Chooses the opening of the jaws before a squeeze and the place of release after it."""

    def __init__(self, job: Job) -> None:
        self._outlines = [alone.part.outline_mm for alone in job.alone]
        self._jaws, self._encoder = jaws_of(job.gripper), encoder_of(job)
        self._area = np.array(job.cell.work_area_mm)
        # If the fingers do not move alike, the opening decides which of them touches first.
        self._alike = job.gripper.upper_finger_share == 0.5

    def opening(self, belief: Belief, placement: Array, *, pushed: bool = False) -> Opening:
        """Chooses the opening of the jaws: `SPARE_MM` wider than at the first contact, if they open so far.

        The jaws open fully where the fingers do not move alike, where the parts were `pushed` before, and
        where the belief has few particles: poses are less certain there.
        """
        contact_mm, opening_mm = self.contact_mm(belief, placement), self._jaws.opening_mm
        if self._alike and not pushed and len(belief) >= LEAST_PARTICLES:
            opening_mm = min(contact_mm + SPARE_MM, opening_mm)
        jaws = self._jaws._replace(opening_mm=opening_mm)
        clearance_mm = min(
            least_clearance(self._outlines[k], jaws, belief.poses[rows], placement)
            for k, rows in by_hypothesis(belief.traits)
        )
        return Opening(opening_mm, max(clearance_mm, 0.0), contact_mm)

    def contact_mm(self, belief: Belief, placement: Array) -> float:
        """Upper bound on the measured width at which closing jaws first touch a part of the belief [mm]."""
        traits, hand = belief.traits, to_hand(belief.poses, placement)
        hand[:, 1] -= traits["across_mm"]
        share = np.clip(self._jaws.upper_share + traits["share"], 0.0, 1.0)
        share, widths = np.round(share, SHARE_DECIMALS), list[float]()
        for k, rows in by_hypothesis(traits):
            contact_mm = first_contacts_mm(self._outlines[k], self._jaws, hand[rows], share[rows])
            _, alike = np.unique(share[rows], return_inverse=True)
            widest_mm = np.zeros(alike.max() + 1)
            np.maximum.at(widest_mm, alike, contact_mm)
            widths.append(float(read_as(widest_mm[alike], traits[rows]).max()))
        return max(widths) + CONTACT_MARGIN_MM

    def clear(self, belief: Belief, placement: Array) -> Belief:
        """Returns the particles that both open fingers clear; a finger would come down on the others."""
        verdict, poses = np.empty(len(belief), np.int64), to_hand(belief.poses, placement)
        for k, rows in by_hypothesis(belief.traits):
            verdict[rows] = classify_contact(self._outlines[k], self._jaws, poses[rows])
        return belief[verdict != STANDS_ON]

    def release(self, outcomes: Outcomes) -> Array | None:
        """Chooses where the jaws open: at the area's middle if a held part may lie where the hand cannot go.

        The paper's cell does the same near the edge of its table (VII.A).

        Args:
            outcomes: the branches of the squeeze.

        Returns:
            (2,) hand centre in the world; None: the hand stays.
        """
        farthest = max(map(reach, self._outlines))
        low, high = self._area[0] + farthest, self._area[1] - farthest
        held = [belief.poses for belief, held in self._branches(outcomes) if held]
        centres = np.concatenate([np.zeros((0, 3)), *held])[:, :2]
        if np.any(low >= high) or np.all((centres >= low) & (centres <= high)):
            return None
        return np.asarray(0.5 * (self._area[0] + self._area[1]))

    def released(self, placement: Array, release: Array | None, outcomes: Outcomes) -> list[Belief]:
        """The beliefs after the jaws have opened: held parts have moved along with the hand."""
        if release is None:
            return outcomes.beliefs
        drag = np.array([*(release - placement[:2]), 0.0])
        return [
            replace(belief, poses=belief.poses + drag) if held else belief
            for belief, held in self._branches(outcomes)
        ]

    def _branches(self, outcomes: Outcomes) -> Iterator[tuple[Belief, bool]]:
        """The belief of each branch, and whether the jaws hold a part there."""
        held = self._encoder.width_mm(outcomes.clusters.mean) >= HELD_MM
        return zip(outcomes.beliefs, held.tolist(), strict=True)
