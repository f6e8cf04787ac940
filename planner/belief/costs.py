"""Cost of actions in units of a typical squeeze: by their seconds, or 1 for each squeeze.

The seconds are those of the table's model of time (`runtime.table.timing`), from where the hand stands after
the previous squeeze to the end of this one. A typical squeeze is the unit, so that the leaf heuristic, which
counts squeezes, and the price of a part that is not located hold for both objectives.
"""

import json
import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.transition import Push, finger_speed_mm_s
from planner.job.cell import timing_of
from planner.job.model import Job
from runtime.table import Stand, Visit, same_from_every_side, turned_pose

PUSH_SQUEEZES = 0.1
"""Cost of a push where squeezes are counted; about the difference in J between two plans."""
TYPICAL_TURN = math.pi / 4.0
"""Turn of the hand before a typical squeeze."""
TYPICAL_WIDTH = 0.5
"""Width at which the jaws stop in a typical squeeze, as a share of their opening."""


class Hand(NamedTuple):
    """State of the hand after an action."""

    placement: Array  # (3,) in the world [mm, mm, rad]
    width_mm: float  # between the jaws


class Closing(NamedTuple):
    """How the jaws close: their openings at the start, at the first contact and at the end [mm]."""

    opening_mm: float  # opening at the start
    contact_mm: float | None  # the greatest width at which they may meet the part; None: unknown
    width_mm: float  # where they stop


class Costs:
    """Costs of squeezes, pushes and moves of the hand, by the objective of a job.

    Attributes:
        timing: of the cell; None where squeezes are counted.
        typical_s: seconds of a typical squeeze.
    """

    def __init__(self, job: Job) -> None:
        timing = timing_of(job)
        self._open_mm, self._speed_mm_s = job.gripper.opening_mm, job.gripper.speed_mm_s
        typical = Visit(
            way_mm=0.0,
            turn_rad=TYPICAL_TURN,
            opening_mm=self._open_mm,
            contact_mm=None,
            width_mm=TYPICAL_WIDTH * self._open_mm,
            speed_mm_s=self._speed_mm_s,
            next_mm=self._open_mm,
        )
        self.timing = timing if job.goal.minimise == "seconds" else None
        self.typical_s = timing.squeeze(typical).total_s
        # A squeeze after half a turn is equivalent where the job's fingers close evenly.
        self._turn = math.pi if job.gripper.upper_finger_share == 0.5 else 2.0 * math.pi
        # Whether plans are turned to the angle at which the hand stands (`runtime.table.turning`).
        same = same_from_every_side(json.loads(job.canonical()), job.goal.kind)
        self._plans_turn = same and not job.actions.pushes

    def short_way(self, hand: Hand | None, placements: Array) -> Array:
        """Grasp poses (k, 3) at the equivalent angle to which the hand turns least.

        The cell uses the same angles, so that each finger stays on the side that the belief assumes, even if
        the two close unevenly.
        """
        if hand is None:
            return placements
        turns = placements[:, 2] - hand.placement[2]
        nearest = placements[:, 2] - self._turn * np.round(turns / self._turn)
        return np.column_stack([placements[:, :2], nearest])

    def squeeze(self, hand: Hand | None, placement: Array, jaws: Closing) -> float:
        """The cost of a squeeze.

        Args:
            hand: where the hand stands; None: above the placement, before the first squeeze of a part.
            placement: (3,) of the squeeze in the world [mm, mm, rad].
            jaws: how they close.
        """
        if self.timing is None:
            return 1.0
        way_mm, turn = (0.0, 0.0) if hand is None else self._way(hand.placement, placement)
        visit = Visit(
            way_mm=way_mm,
            turn_rad=turn,
            opening_mm=jaws.opening_mm,
            contact_mm=jaws.contact_mm,
            width_mm=min(jaws.width_mm, jaws.opening_mm),
            speed_mm_s=self._speed_mm_s,
            next_mm=self._open_mm,
            from_retreat=hand is None,
            jaws_s=0.0 if hand is None else self._opening_s(hand.width_mm, jaws.opening_mm),
        )
        return self.timing.squeeze(visit).total_s / self.typical_s

    def back(self, hand: Hand | None, home: Array | None) -> float:
        """The cost of the way to `home` (3,), the placement of the next part's first squeeze in the world."""
        if self.timing is None or hand is None or home is None:
            return 0.0
        if self._plans_turn:
            stand, first = Stand(*hand.placement.tolist()), Stand(*home.tolist())
            home = np.array(turned_pose(first, stand.turn_from(first)))
        return self.timing.move_s(*self._way(hand.placement, home)) / self.typical_s

    def pushes(self, hand: Hand | None, pushes: tuple[Push, ...]) -> tuple[float, Hand | None]:
        """The cost of pushes, and the hand after them."""
        if self.timing is None:
            return PUSH_SQUEEZES * len(pushes), hand
        seconds, open_mm = 0.0, self._open_mm
        for push in pushes:
            way_mm, turn = (0.0, 0.0) if hand is None else self._way(hand.placement, push.start)
            seconds += self.timing.push_s(
                way_mm,
                turn,
                stroke_mm=abs(open_mm - push.opening_mm),
                stroke_mm_s=self._speed_mm_s,
                push_mm=push.way_mm,
                push_mm_s=finger_speed_mm_s(self._speed_mm_s),
            )
            open_mm, angle = push.opening_mm, push.start[2]
            ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
            hand = Hand(push.start + push.way_mm * ahead, open_mm)
        return seconds / self.typical_s, hand

    def _way(self, before: Array, placement: Array) -> tuple[float, float]:
        """Distance [mm] and turn [rad] from one placement of the hand to another."""
        x, y, turn = (placement - before).tolist()
        return math.hypot(x, y), math.remainder(turn, math.tau)

    def _opening_s(self, width_mm: float, opening_mm: float) -> float:
        """Seconds for which the jaws still have to open after the hand has risen from its last squeeze."""
        assert self.timing is not None  # seconds are counted
        rise_s = self.timing.move_s(self.timing.regrasp_mm - self.timing.squeeze_mm)
        return max(self.timing.opening_s(width_mm, opening_mm, self._speed_mm_s) - rise_s, 0.0)
