"""The learned motion model of `model = "kcde"`: a density estimate, and direct simulation where that fails.

It fails where no roll-out lies near a particle, and where the belief is denser than the roll-outs, as after a
squeeze that leaves most of it in a few poses: the same roll-out is then drawn again and again, and with it
the one friction and limit surface it happened to have. So a roll-out serves one particle of a belief, and the
others that draw it are simulated.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import Encoder, encoder_of
from planner.belief.transition import EXACT, Case, Placing, Squeezed, placing_of, squeezed_by
from planner.job.model import Job
from planner.learned.kcde import Kcde
from planner.learned.rollouts import RollOuts, region_radius, roll_outs
from planner.learned.store import Store
from planner.mechanics.simulator import RollOut, Simulator
from planner.mechanics.squeeze import JAMMED, UNTOUCHED
from planner.mechanics.traits import Traits, as_planned, ordinary
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads

FARTHEST = 2.0
"""Distance of the nearest roll-out beyond which a particle is simulated, in spacings of the roll-outs."""
H1_SPACINGS = 0.125  # h1, in spacings of the roll-outs
H2_MM = 0.05
"""h2. Both are far below what the held-out likelihood prefers; the energy distance decides (0011)."""


@dataclass(frozen=True, slots=True, eq=False)
class LearnedModel:
    """Motion and sensor model, interchangeable with `planner.belief.transition.MotionModel`."""

    simulator: Simulator  # what the roll-outs were made with, for particles that they do not cover
    encoder: Encoder  # what reads the widths
    motion: Kcde  # the estimate
    status: IntArray  # (n,) status of each of the estimate's roll-outs
    farthest_mm: float  # distance of the nearest roll-out up to which the estimate is used
    placing: Placing = EXACT  # how well the hand comes to where it is sent

    @classmethod
    def fit(cls, simulator: Simulator, encoder: Encoder, order: int, rolled: RollOuts) -> Self:
        """Learns the model from roll-outs of the simulator, for a part of a rotational order.

        Raises:
            ValueError: no roll-out touches the part.
        """
        outline, jaws, rho = simulator.outline, simulator.jaws, simulator.surface.rho_mm
        motion = Kcde.fit(rolled, outline, jaws, rho, order, h2_mm=H2_MM)
        spacing = motion.grid.spacing_mm
        motion = motion._replace(h1_mm=H1_SPACINGS * spacing)
        return cls(simulator, encoder, motion, rolled.status, FARTHEST * spacing)

    def roll_out(
        self, poses: Array, belief: IntArray, rng: np.random.Generator, traits: Traits | None = None
    ) -> RollOut:
        """Squeezes poses (n, 3) in the hand frame, jaws open, as `Simulator.roll_out` does.

        `belief` (n,) numbers the beliefs, from 0 on, that each is a particle of; those with `traits` (n,) of
        their own are simulated.
        """
        drawn = self.motion.sample(poses, rng, self.simulator.workers)
        touched = drawn.source >= 0
        missed = np.where(drawn.width_mm > 0.0, JAMMED, UNTOUCHED)
        status = np.where(touched, self.status[drawn.source], missed)
        given_up = np.zeros(len(poses), np.int64)
        parts_traits = as_planned(len(poses)) if traits is None else traits
        covered = self.covered(drawn.source, drawn.nearest_mm, belief) & ordinary(parts_traits)
        direct = np.flatnonzero(touched & ~covered)
        parameters = self.simulator.sample(len(direct), rng, parts_traits[direct])
        rolled = self.simulator.roll_out(poses[direct], parameters)
        drawn.poses[direct] = rolled.poses
        drawn.width_mm[direct] = rolled.width_mm
        status[direct] = rolled.status
        given_up[direct] = rolled.given_up
        return RollOut(drawn.poses, drawn.width_mm, status, given_up)

    def covered(self, source: IntArray, nearest_mm: Array, belief: IntArray) -> BoolArray:
        """Where the estimate may be used: draws `source` (n,) of particles of `belief` (n,)."""
        first = np.zeros(len(source), np.bool_)
        first[np.unique(belief * (len(self.status) + 1) + source, return_index=True)[1]] = True
        return np.asarray(first & (nearest_mm <= self.farthest_mm))

    def squeeze(self, cases: list[Case], rng: np.random.Generator) -> list[Squeezed]:
        """As `MotionModel.squeeze`."""

        def roll_out(poses: Array, case: IntArray, traits: Traits) -> RollOut:
            return self.roll_out(poses, case, rng, traits)

        return squeezed_by(cases, roll_out, self.encoder, rng, self.placing)


def learns(job: Job) -> bool:
    """Whether a job's look-ahead uses a learned model: where it says so.

    "auto" is the simulator: learning once costs about as much as it saves, and the plans are no better
    (decision 0011). What the cache happens to hold may not decide: it would change the table's bytes.
    """
    return job.search.model == "kcde"


def learned_model(
    job: Job,
    simulator: Simulator,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> tuple[LearnedModel, RollOuts]:
    """The model learned from the roll-outs of a job, and the roll-outs; arguments as `roll_outs`.

    Raises:
        UnreachableError: the cluster was lost.
    """
    scheduler = scheduler or Threads(simulator.workers)
    rolled = roll_outs(simulator, region_radius(job), job.search.rollouts, store, scheduler, report)
    model = LearnedModel.fit(simulator, encoder_of(job), job.part.symmetry, rolled)
    return replace(model, placing=placing_of(job)), rolled
