"""The stochastic contact world: the model's own idea of reality, shared by evaluation and cell.

`make` is the default world factory of `plan-evaluate --world` and `grasp-cell --world`. A world knows nothing
of the plan: it squeezes one part and says where the part and the fingers ended.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array
from planner.job import Job
from planner.mechanics.simulator import STATUS_NAMES, RollOut, Simulator
from planner.search.actions import least_clearance

Pose = tuple[float, float, float]


class ContactWorld:
    """Squeezes with mechanics drawn afresh each time (paper IV: Wishart limit surface, uniform friction)."""

    def __init__(self, job: Job, seed: int, workers: int | None = None) -> None:
        self._simulator = Simulator.of_job(job, workers)
        self._rng = np.random.default_rng([seed, 0x57524C44])

    def squeeze(self, pose_hand: Pose) -> tuple[Pose, float, str]:
        """Closes the fingers on the part.

        Args:
            pose_hand: the part in the hand frame, jaws open [mm, mm, rad].

        Returns:
            The final pose in the hand frame, the true width [mm] and the status.

        Raises:
            ValueError: the pose is not finite.
        """
        if not all(map(math.isfinite, pose_hand)):
            raise ValueError(f"the pose {pose_hand} is not finite; a world squeezes parts that lie somewhere")
        rolled = self.squeeze_many(np.array([pose_hand], dtype=np.float64))
        x, y, theta = rolled.poses[0]
        return (float(x), float(y), float(theta)), float(rolled.width_mm[0]), STATUS_NAMES[rolled.status[0]]

    def squeeze_many(self, poses_hand: Array) -> RollOut:
        """Squeezes (n, 3) poses, each with its own mechanics: the same as `squeeze`, in a batch."""
        parameters = self._simulator.sample(len(poses_hand), self._rng)
        return self._simulator.roll_out(poses_hand, parameters)

    def collides(self, pose_hand: Pose, opening_mm: float) -> bool:
        """Whether fingers opened to `opening_mm` would stand on the part."""
        jaws = self._simulator.jaws.copy()
        jaws[0] = opening_mm
        pose = np.array([pose_hand], dtype=np.float64)
        return least_clearance(self._simulator.outline, jaws, pose, np.zeros(3), margin_mm=0.0) < 0.0


def make(job: Job, seed: int) -> ContactWorld:
    """The world factory.

    Args:
        job: the parsed job.
        seed: of all the world's randomness.
    """
    return ContactWorld(job, seed)
