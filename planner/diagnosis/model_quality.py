"""How good the learned models of a job are, judged by what they were learned from: the squeeze itself.

A motion model's push-forward is judged by the energy distance between two samples of poses,

    E(A, B) = 2 mean|a - b| - mean|a - a'| - mean|b - b'|        (Szekely and Rizzo 2013)

with all pairs in the means, also of a pose with itself. It is zero for equal samples only, and needs no bins.
Poses are compared as points (x, y, r cos n theta, r sin n theta), r = rho / n: near one another that is the
paper's normalised pose (V.A), without a seam where the angle wraps under the rotational order n.
"""

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.particles import Belief, initial
from planner.belief.transition import MotionModel, Simulation
from planner.frames import to_hand
from planner.job.model import Job
from planner.learned.model import LearnedModel
from planner.learned.rollouts import COLLIDES, RollOuts, region_radius
from planner.mechanics.clearance import STANDS_ON, classify_contact, free_placements
from planner.mechanics.simulator import Simulator
from planner.paper.sensor import CollisionTree, SensorError, SensorModel
from planner.paper.subspaces import Subspaces, subspaces_of
from planner.search.actions import actions_of
from planner.work.progress import Report, silent


class Comparison(NamedTuple):
    """A model's push-forward of a belief beside the simulator's, after some squeezes."""

    squeezes: int  # how many
    model_mm: (
        float  # energy distance of a run of the model from one of the simulator, mean of all pairs
    )
    simulator_mm: float  # the same between two runs of the simulator

    @property
    def ratio(self) -> float:
        """How much farther the model is from the simulator than the simulator is from itself."""
        if self.model_mm == self.simulator_mm:
            return 1.0
        return self.model_mm / self.simulator_mm if self.simulator_mm > 0.0 else float("inf")


def energy_distance(a: Array, b: Array, rho_mm: float, order: int = 1) -> float:
    """Energy distance of two samples of poses (n, 3) and (m, 3), n, m >= 1 [mm]; at least 0.

    `rho_mm` is what one radian weighs, `order` the part's rotational order.
    """
    from scipy.spatial.distance import cdist  # half as long to import as numba

    radius = rho_mm / order

    def points(poses: Array) -> Array:
        """(n, 4) whose Euclidean distances respect the part's symmetry [mm]."""
        turn = order * poses[:, 2]
        return np.column_stack(
            [poses[:, 0], poses[:, 1], radius * np.cos(turn), radius * np.sin(turn)]
        )

    first, second = points(a), points(b)
    within = float(cdist(first, first).mean() + cdist(second, second).mean())
    return max(2.0 * float(cdist(first, second).mean()) - within, 0.0)


def compare(
    model: MotionModel,
    reference: MotionModel,
    beliefs: Sequence[Array],
    placements: Array,
    rho_mm: float,
    order: int,
    rng: np.random.Generator,
) -> list[Comparison]:
    """Compares push-forwards of a belief through squeezes at placements (k, 3), one comparison after each.

    Runs that start from the same particles differ by the squeezes' doing alone: that is the strictest
    comparison. Runs that start from particles of their own also differ as samples of one belief do. Each run
    starts from (n, 3) particles in the world, n >= 1 [mm, mm, rad]: as many runs of the simulator
    (`reference`), at least 2, after as many of the model. `rho_mm` is what one radian weighs, `order` the
    part's rotational order.
    """
    half = len(beliefs) // 2
    models = [model] * half + [reference] * half
    runs = [
        _push(squeezer, Belief.of(belief), placements, stream)
        for squeezer, belief, stream in zip(models, beliefs, rng.spawn(2 * half), strict=True)
    ]

    def mean_mm(k: int, pairs: list[tuple[list[Array], list[Array]]]) -> float:
        return float(np.mean([energy_distance(a[k], b[k], rho_mm, order) for a, b in pairs]))

    tried, true = runs[:half], runs[half:]
    between, within = list(product(tried, true)), list(combinations(true, 2))
    return [
        Comparison(k + 1, mean_mm(k, between), mean_mm(k, within)) for k in range(len(placements))
    ]


def _push(
    model: MotionModel, belief: Belief, placements: Array, rng: np.random.Generator
) -> list[Array]:
    """The poses (n, 3) after each of a sequence of squeezes."""
    poses = []
    for placement in placements:
        belief = model.squeeze([(belief, placement)], rng)[0].belief
        poses.append(belief.poses)
    return poses


PARTICLES = 2000
RUNS = 4  # of the model and of the simulator
PLACEMENTS = 100_000
SEED = 0x5155


class Confusion(NamedTuple):
    """A detector's verdicts beside the exact ones."""

    free: int  # placements that are free
    colliding: int  # placements that are not
    false_alarm_rate: float  # share of the free ones that the detector calls colliding
    miss_rate: float  # share of the colliding ones that it calls free


class ActionQuality(NamedTuple):
    """The motion model under one action."""

    placement: Array  # (3,) the hand frame in the world [mm, mm, rad]
    comparison: Comparison  # of the push-forwards of the job's belief
    simulated: float  # share of the particles that the model leaves to the simulator


class Quality(NamedTuple):
    """What there is to say about the models of a job."""

    rollouts: int  # how many there are
    colliding: float  # share of them in which an open finger would stand on the part
    spacing_mm: float  # typical distance of neighbours
    h1_mm: float  # bandwidth of initial poses
    h2_mm: float  # bandwidth of final poses
    actions: list[ActionQuality]  # the fixed actions that are free of collision
    in_collision: int  # how many are not, and were left out
    sensor: SensorError  # error on roll-outs held out
    collision: Confusion  # of fresh placements, the jaws fully open
    subspaces: Subspaces  # clusters of the widths
    label: IntArray  # (n,) the subspace of each roll-out that does not collide
    final: Array  # (n, 3) their final poses in the hand frame [mm, mm, rad]


def quality(job: Job, model: LearnedModel, rolled: RollOuts, report: Report = silent) -> Quality:
    """Judges the motion model of a job and the roll-outs it was learned from."""
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
    return Quality(
        rollouts=len(rolled.initial),
        colliding=float(np.mean(~standing)),
        spacing_mm=model.motion.grid.spacing_mm,
        h1_mm=model.motion.h1_mm,
        h2_mm=model.motion.h2_mm,
        actions=actions,
        in_collision=int(np.count_nonzero(~free)),
        sensor=SensorModel.fit(final, width_mm, job.part.symmetry).error,
        collision=_confusion(job, rolled, simulator, rng),
        subspaces=subspaces,
        label=subspaces.label(width_mm),
        final=final,
    )


def _confusion(
    job: Job, rolled: RollOuts, simulator: Simulator, rng: np.random.Generator
) -> Confusion:
    """The paper's collision detector, learned from the roll-outs, on placements all over their region."""
    detector = CollisionTree.fit(rolled.initial, rolled.status == COLLIDES, job.part.symmetry)
    poses = rng.uniform([0.0, -np.pi, -np.pi], [1.0, np.pi, np.pi], (PLACEMENTS, 3))
    radius, bearing = region_radius(job) * np.sqrt(poses[:, 0]), poses[:, 1].copy()
    poses[:, 0], poses[:, 1] = radius * np.cos(bearing), radius * np.sin(bearing)
    hits = classify_contact(simulator.outline, simulator.jaws, poses) == STANDS_ON
    said = detector.collides(poses)
    free, colliding = int(np.count_nonzero(~hits)), int(np.count_nonzero(hits))
    alarms, missed = np.count_nonzero(said & ~hits), np.count_nonzero(hits & ~said)
    return Confusion(
        free, colliding, float(alarms / max(free, 1)), float(missed / max(colliding, 1))
    )


def _judged(
    model: LearnedModel, belief: Array, placement: Array, rng: np.random.Generator
) -> ActionQuality:
    reference = Simulation(model.simulator, model.encoder)
    rho, order = model.motion.rho_mm, model.motion.order
    (comparison,) = compare(model, reference, [belief] * 2 * RUNS, placement[None], rho, order, rng)
    drawn = model.motion.sample(to_hand(belief, placement), rng, model.simulator.workers)
    covered = model.covered(drawn.source, drawn.nearest_mm, np.zeros(len(belief), np.int64))
    return ActionQuality(placement, comparison, float(np.mean((drawn.source >= 0) & ~covered)))
