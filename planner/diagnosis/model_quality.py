"""How good the learned models of a job are, judged by what they were learned from: the squeeze itself.

Motion by energy distance, in units of what two runs of the simulator differ by; the sensor on roll-outs held
out; the collision detector on fresh placements; and the subspaces that widths stand for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.particles import initial
from planner.belief.transition import Simulation
from planner.frames import to_hand
from planner.job import Job
from planner.learned.energy import Comparison, compare
from planner.learned.model import LearnedModel
from planner.learned.region import region_radius
from planner.learned.rollouts import COLLIDES, RollOuts
from planner.paper.collision import CollisionDetector, Confusion, placements
from planner.paper.sensor import SensorError, SensorModel
from planner.paper.subspaces import Subspaces, subspaces_of
from planner.progress import Report, silent
from planner.search.actions import actions_of, free_placements

PARTICLES = 2000
RUNS = 4
"""Of the model and of the simulator."""
PLACEMENTS = 100_000
SEED = 0x5155


class ActionQuality(NamedTuple):
    """The motion model under one action.

    Attributes:
        placement: (3,) the hand frame in the world [mm, mm, rad].
        comparison: of the push-forwards of the job's belief.
        simulated: share of the particles that the model leaves to the simulator.
    """

    placement: Array
    comparison: Comparison
    simulated: float


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """What there is to say about the models of a job.

    Attributes:
        rollouts: how many there are.
        colliding: share of them in which an open finger would stand on the part.
        spacing_mm: typical distance of neighbours.
        h1_mm: bandwidth of initial poses.
        h2: bandwidth of final poses, in units of the scatter near by.
        actions: the fixed actions that are free of collision.
        in_collision: how many are not, and were left out.
        sensor: error on roll-outs held out.
        collision: fresh placements with the jaws fully open, and opened anywhere.
        subspaces: clusters of the widths.
        label: (n,) the subspace of each roll-out that does not collide.
        final: (n, 3) their final poses in the hand frame [mm, mm, rad].
    """

    rollouts: int
    colliding: float
    spacing_mm: float
    h1_mm: float
    h2: float
    actions: list[ActionQuality]
    in_collision: int
    sensor: SensorError
    collision: tuple[Confusion, Confusion]
    subspaces: Subspaces
    label: IntArray
    final: Array


def quality(job: Job, model: LearnedModel, rolled: RollOuts, report: Report = silent) -> Quality:
    """Judges the models of a job.

    Args:
        job: the checked job.
        model: its motion model.
        rolled: the roll-outs that this was learned from.
        report: told about progress.

    Returns:
        The same for the same job, on any number of workers.
    """
    rng = np.random.default_rng([job.seed, SEED])
    belief = initial(job, PARTICLES, rng)
    fixed = actions_of(job).placements
    simulator = model.simulator
    free = free_placements(simulator.outline, simulator.jaws, belief, fixed, 0.0)
    actions = []
    for number, placement in enumerate(fixed[free]):
        report("judge the motion", number, int(np.count_nonzero(free)))
        actions.append(_judged(model, belief, placement, rng))
    report("judge sensor and collision", 0, 1)
    standing = rolled.status != COLLIDES
    final, width_mm = rolled.final[standing], rolled.width_mm[standing]
    subspaces = subspaces_of(width_mm, model.encoder)
    bandwidths = model.bandwidths
    return Quality(
        rollouts=len(rolled.initial),
        colliding=float(np.mean(~standing)),
        spacing_mm=model.motion.grid.spacing_mm,
        h1_mm=model.motion.h1_mm,
        h2=bandwidths.best.h2 if bandwidths else 1.0,
        actions=actions,
        in_collision=int(np.count_nonzero(~free)),
        sensor=SensorModel.fit(final, width_mm, job.part.symmetry).error,
        collision=collision_quality(simulator.outline, simulator.jaws, job, rng),
        subspaces=subspaces,
        label=subspaces.label(width_mm),
        final=final,
    )


def collision_quality(
    outline: Array, jaws: Array, job: Job, rng: np.random.Generator
) -> tuple[Confusion, Confusion]:
    """Learns a collision detector and judges it, with the jaws fully open and opened anywhere."""
    radius = region_radius(job)
    detector = CollisionDetector.fit(outline, jaws, job.part.symmetry, radius, rng)
    opened, anywhere = (
        detector.judged(outline, *placements(outline, jaws, radius, PLACEMENTS, rng, any_opening))
        for any_opening in (False, True)
    )
    return opened, anywhere


def _judged(model: LearnedModel, belief: Array, placement: Array, rng: np.random.Generator) -> ActionQuality:
    """The motion model under one action."""
    reference = Simulation(model.simulator, model.encoder)
    rho, order = model.motion.rho_mm, model.motion.order
    (comparison,) = compare(model, reference, [belief] * 2 * RUNS, placement[None], rho, order, rng)
    drawn = model.motion.sample(to_hand(belief, placement), rng, model.simulator.workers)
    covered = model.covered(drawn.source, drawn.nearest_mm, np.zeros(len(belief), np.int64))
    return ActionQuality(placement, comparison, float(np.mean((drawn.source >= 0) & ~covered)))
