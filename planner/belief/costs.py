"""Cost of actions in units of a typical squeeze: by their seconds, or 1 for each squeeze.

The table's model of time (`runtime.table.timing`) gives the seconds, from where the hand stands after
the previous squeeze to the end of this one. A typical squeeze is the unit, so that the leaf heuristic, which
counts squeezes, and the price of a part that is not located hold for both objectives.
"""

import json
import math
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.transition import Push, finger_speed_mm_s
from planner.job.cell import timing_of
from planner.job.model import Job
from runtime.table import Visit, same_from_every_side, turned_pose

PUSH_SQUEEZES = 0.1
"""Cost of a push where squeezes are counted; about the difference in J between two plans."""
TYPICAL_TURN = math.pi / 4.0
"""Turn of the hand before a typical squeeze."""
TYPICAL_WIDTH = 0.5
"""Width at which the jaws stop in a typical squeeze, as a share of their opening."""


class Hand(NamedTuple):
    """State of the hand after an action."""

    placement: Array  # (3,) pose of the hand in the world [mm, mm, rad]
    width_mm: float  # opening of the jaws


class Closing(NamedTuple):
    """How the jaws close: their openings at the start, at the first contact and at the end [mm]."""

    opening_mm: float  # opening at the start
    contact_mm: float | None  # the greatest width at which they may meet the part; None: unknown
    width_mm: float  # where they stop


class Costs:
    """Costs of squeezes, pushes and moves of the hand, by the objective of a job.

    Attributes:
        timing: the model of time of the cell.
        typical_s: seconds of a typical squeeze.
    """

    def __init__(self, job: Job) -> None:
        self.timing, self._timed = timing_of(job), job.goal.minimise == "seconds"
        self._open_mm, self._speed_mm_s = job.gripper.opening_mm, job.gripper.speed_mm_s
        typical = Closing(self._open_mm, None, TYPICAL_WIDTH * self._open_mm)
        self.typical_s = self._squeeze_s((0.0, TYPICAL_TURN), typical)
        # A squeeze after half a turn is equivalent where the job's fingers close evenly.
        self._turn = math.pi if job.gripper.upper_finger_share == 0.5 else 2.0 * math.pi
        # Whether plans are turned to the angle at which the hand stands (`runtime.table.turning`).
        same = same_from_every_side(json.loads(job.canonical()), job.goal.kind)
        self._plans_turn = same and not job.actions.pushes

    def short_way(self, hand: Hand | None, placements: Array) -> Array:
        """Replaces the angle of each grasp pose (k, 3) by the equivalent one to which the hand turns least.

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
            placement: (3,) grasp pose in the world [mm, mm, rad].
            jaws: how the jaws close.
        """
        if not self._timed:
            return 1.0
        jaws = jaws._replace(width_mm=min(jaws.width_mm, jaws.opening_mm))
        if hand is None:
            return self._squeeze_s((0.0, 0.0), jaws, from_retreat=True) / self.typical_s
        # Jaws that still open when the hand has risen from its last squeeze delay it.
        rise_s = self.timing.move_s(self.timing.regrasp_mm - self.timing.squeeze_mm)
        opening_s = self.timing.opening_s(hand.width_mm, jaws.opening_mm, self._speed_mm_s)
        left_s, way = max(opening_s - rise_s, 0.0), self._way(hand, placement)
        return self._squeeze_s(way, jaws, jaws_s=left_s) / self.typical_s

    def back(self, hand: Hand | None, home: Array | None) -> float:
        """Cost of moving the hand to `home` (3,), the grasp pose of the next part's first squeeze.

        If the cell turns each plan about the world's origin to the angle at which the hand stands, `home` is
        turned in the same way. The cost is 0 if the job counts squeezes, or if `hand` or `home` is None.
        """
        if not self._timed or hand is None or home is None:
            return 0.0
        if self._plans_turn:
            turn = math.remainder(hand.placement[2] - home[2], math.tau)
            home = np.array(turned_pose(home.tolist(), turn))
        return self.timing.move_s(*self._way(hand, home)) / self.typical_s

    def pushes(self, hand: Hand | None, pushes: tuple[Push, ...]) -> tuple[float, Hand | None]:
        """The cost of pushes, and the hand after them."""
        if not self._timed:
            return PUSH_SQUEEZES * len(pushes), hand
        seconds, open_mm = 0.0, self._open_mm
        for push in pushes:
            seconds += self.timing.push_s(
                *self._way(hand, push.start),
                stroke_mm=abs(open_mm - push.opening_mm),
                stroke_mm_s=self._speed_mm_s,
                push_mm=push.way_mm,
                push_mm_s=finger_speed_mm_s(self._speed_mm_s),
            )
            open_mm, angle = push.opening_mm, push.start[2]
            ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
            hand = Hand(push.start + push.way_mm * ahead, open_mm)
        return seconds / self.typical_s, hand

    def _squeeze_s(self, way: tuple[float, float], jaws: Closing, **more: Any) -> float:
        """Seconds of a squeeze, including the travel of the hand to it.

        Args:
            way: distance [mm] and turn [rad] of the hand, as `_way` returns them.
            jaws: how the jaws close.
            more: further fields of `Visit`.
        """
        visit = Visit(
            way_mm=way[0],
            turn_rad=way[1],
            speed_mm_s=self._speed_mm_s,
            next_mm=self._open_mm,
            **jaws._asdict(),
            **more,
        )
        return self.timing.squeeze(visit).total_s

    def _way(self, hand: Hand | None, placement: Array) -> tuple[float, float]:
        """Distance [mm] and turn [rad] from the hand to a placement; both are 0 if `hand` is None."""
        if hand is None:
            return 0.0, 0.0
        x, y, turn = (placement - hand.placement).tolist()
        return math.hypot(x, y), math.remainder(turn, math.tau)
