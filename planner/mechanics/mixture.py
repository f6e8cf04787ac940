"""Simulator for jobs with several hypotheses: simulates each part with the simulator of its hypothesis."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from planner.arrays import Array
from planner.job.model import Job
from planner.mechanics.clearance import Jaws
from planner.mechanics.simulator import DEFAULT_STEP_MM, RollOut, Simulator, in_order
from planner.mechanics.traits import Traits, by_hypothesis


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Simulates squeezes and pushes of several possible parts, or of a single one, by one gripper."""

    simulators: tuple[Simulator, ...]  # one for each hypothesis

    @classmethod
    def of_job(cls, job: Job, workers: int | None = None, step_mm: float = DEFAULT_STEP_MM) -> Self:
        """Builds a simulator for each hypothesis of a job; they use all cores by default."""
        return cls(tuple(Simulator.of_job(alone, workers, step_mm) for alone in job.alone))

    @property
    def jaws(self) -> Jaws:
        """The jaws of the gripper."""
        return self.simulators[0].jaws

    @property
    def workers(self) -> int:
        """Number of threads that share the simulated squeezes and pushes."""
        return self.simulators[0].workers

    @property
    def outlines(self) -> tuple[Array, ...]:
        """The outline (N, 2) of each hypothesis's part, counter-clockwise [mm]."""
        return tuple(simulator.outline for simulator in self.simulators)

    def squeeze(self, poses: Array, rng: np.random.Generator, traits: Traits) -> RollOut:
        """Squeezes parts with latent parameters `traits` (n,) at poses (n, 3) in the hand frame.

        Draws random mechanics for each squeeze.
        """
        pieces = [
            (rows, self.simulators[k].squeeze(poses[rows], rng, traits[rows]))
            for k, rows in by_hypothesis(traits)
        ]
        return pieces[0][1] if len(pieces) == 1 else in_order(pieces, len(poses))

    def push_by_hand(
        self,
        poses: Array,
        opening_mm: Array,
        way_mm: Array,
        rng: np.random.Generator,
        traits: Traits,
    ) -> Array:
        """Pushes parts with the ends of the fingers, each part by the simulator of its hypothesis.

        See `Simulator.push_by_hand`.
        """
        final = np.empty((len(poses), 3))
        for k, rows in by_hypothesis(traits):
            part_world, each = self.simulators[k], (opening_mm[rows], way_mm[rows])
            final[rows] = part_world.push_by_hand(poses[rows], *each, rng, traits[rows])
        return final
