"""What a squeeze costs, in units of itself: 1, and something for its time and for its risk."""

from __future__ import annotations

from typing import NamedTuple

from planner.belief.transition import Outcomes
from planner.job import Job

LEAST_SQUEEZE = 0.001
"""A squeeze that costs nothing still costs this much: of two plans as good the shorter is better."""


class Costs(NamedTuple):
    """The price of a squeeze.

    Attributes:
        squeeze: of any, as a probability of success.
        second: of a second of cell time, likewise.
        unstable: of an outcome that friction alone holds, likewise.
        lift_s: time to go up and come down again [s].
        opening_mm: stroke of the open jaws.
        speed_mm_s: rate at which the opening closes.
    """

    squeeze: float
    second: float
    unstable: float
    lift_s: float
    opening_mm: float
    speed_mm_s: float

    @property
    def least(self) -> float:
        """What a squeeze costs at least, as a probability of success."""
        return max(self.squeeze, LEAST_SQUEEZE)

    def of(self, outcomes: Outcomes) -> float:
        """C of an action with these outcomes, in squeezes."""
        seconds = self.lift_s + 2.0 * (self.opening_mm - outcomes.width_mm) / self.speed_mm_s
        extra = self.second * seconds + self.unstable * outcomes.unstable
        return 1.0 + extra / self.least


def costs_of(job: Job) -> Costs:
    """The costs that a job states."""
    search, cell, gripper = job.search, job.cell, job.gripper
    lift = 2.0 * (cell.retreat_height_mm - cell.squeeze_height_mm) / cell.arm_speed_mm_s
    return Costs(
        search.squeeze_cost, search.second_cost, search.stability_cost, lift, gripper.opening_mm,
        gripper.speed_mm_s,
    )  # fmt: skip
