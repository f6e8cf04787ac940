"""A table against a world, over many trials (paper VII): the only judge of a plan.

The trials run the table as the runtime does: encoder counts, the look-up of the table, REJECT outside every
interval. Nothing of the planner's belief enters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief import initial
from planner.encoder import Encoder, encoder_of
from planner.frames import to_hand, to_world
from planner.goal import Metric
from planner.job import Job
from planner.statistics import wilson_interval
from runtime.table import REJECT, Calibration, Node, Squeeze, Table, count_map

RUNNING = -2
REJECTED = -1


class World(Protocol):
    """What a world offers: `squeeze(pose_hand) -> (final_pose_hand, width_mm, status)`."""

    def squeeze(self, pose_hand: tuple[float, float, float]) -> tuple[Any, float, str]:
        """Closes the fingers on a part at a pose in the hand frame [mm, mm, rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """The outcome of each of n trials.

    Attributes:
        leaf: (n,) index of the leaf reached, `REJECTED` where a width fitted no branch.
        squeezes: (n,) how many it took.
        seconds: (n,) estimated time.
        error_mm: (n,) audit metric of the leaf's pose against the true pose; infinite without a leaf.
        resolved: (n,) whether the leaf claims to know the pose.
        goal_mm: the goal of the metric.
        crashes: placements at which an open finger would have stood on the part.
        poses: (n, 3) true final poses in the world.
    """

    leaf: IntArray
    squeezes: IntArray
    seconds: Array
    error_mm: Array
    resolved: BoolArray
    goal_mm: float
    crashes: int
    poses: Array

    @property
    def success(self) -> BoolArray:
        """Trials that ended in a resolved leaf within the goal."""
        return np.asarray(self.resolved & (self.error_mm < self.goal_mm))

    @property
    def wrong(self) -> BoolArray:
        """Trials that ended in a resolved leaf, but not within the goal: confident and wrong."""
        return np.asarray(self.resolved & ~(self.error_mm < self.goal_mm))

    def summary(self) -> dict[str, Any]:
        """The figures of `plan-evaluate --json`."""
        n = len(self.leaf)
        successes = int(self.success.sum())
        unresolved = (self.leaf >= 0) & ~self.resolved
        return {
            "trials": n,
            "success_rate": successes / n,
            "success_ci95": list(wilson_interval(successes, n)),
            "wrong_rate": float(self.wrong.mean()),
            "reject_rate": float((self.leaf == REJECTED).mean()),
            "unresolved_rate": float(unresolved.mean()),
            "mean_squeezes": float(self.squeezes.mean()),
            "max_squeezes": int(self.squeezes.max()),
            "mean_seconds": float(self.seconds.mean()),
            "crashes": self.crashes,
        }


def evaluate(table: Table, job: Job, world: World, trials: int, seed: int) -> Evaluation:
    """Runs a table on many parts.

    Args:
        table: the table, canonical.
        job: the job it was compiled from.
        world: where the parts are squeezed.
        trials: number of parts, at least 1.
        seed: of initial poses and encoder noise; the world has its own.
    """
    rng = np.random.default_rng([seed, 0x4556414C])
    trial = _Trials(table, job, initial(job, trials, rng), encoder_of(job))
    for _ in range(table.limits.max_depth + 1):
        for index in sorted(set(trial.node[trial.node >= 0].tolist())):
            trial.squeeze(index, np.flatnonzero(trial.node == index), world, rng)
        trial.descend()
        if not np.any(trial.node >= 0):
            break
    return trial.evaluation(metric_of_table(table))


def metric_of_table(table: Table) -> Metric:
    """The audit metric that the table states."""
    goal = table.goal
    return Metric(goal.distance_um / 1e3, goal.rho_um / 1e3, goal.symmetry)


def placement_of(squeeze: Squeeze) -> Array:
    """The hand frame in the world of a table's squeeze, (3,) [mm, mm, rad]."""
    return np.array([squeeze.x_um / 1e3, squeeze.y_um / 1e3, squeeze.angle_urad / 1e6])


class _Trials:
    """The state of all trials; `node` is the node each stands at, or a negative outcome."""

    def __init__(self, table: Table, job: Job, poses: Array, encoder: Encoder) -> None:
        n = len(poses)
        self.table, self.job, self.poses, self.encoder = table, job, poses, encoder
        self.node: IntArray = np.zeros(n, np.int64)
        self.next: IntArray = np.zeros(n, np.int64)
        self.leaf: IntArray = np.full(n, RUNNING, np.int64)
        self.squeezes: IntArray = np.zeros(n, np.int64)
        self.seconds: Array = np.zeros(n)
        self.hand: Array = np.zeros((n, 2))
        self.crashes = 0
        self.calibration = Calibration.linear(table.gripper)

    def squeeze(self, index: int, members: IntArray, world: World, rng: np.random.Generator) -> None:
        """Squeezes the trials that stand at one node and looks up where each goes."""
        node = self.table.nodes[index]
        placement = placement_of(node.squeeze)
        hand = to_hand(self.poses[members], placement)
        self._count_crashes(world, hand, node.squeeze.opening_um / 1e3)
        final, width = _squeeze_all(world, hand)
        self.poses[members] = to_world(final, placement)
        self.squeezes[members] += 1
        self._spend(members, node.squeeze, placement, width)
        counts = self.encoder.read(width, rng)
        self.next[members] = _targets(node, self.calibration)[counts]

    def descend(self) -> None:
        """Moves every running trial to where its look-up led: a node, a leaf (~leaf), or a rejection."""
        running = self.node >= 0
        ended = running & (self.next < 0)
        rejected = ended & (self.next == np.iinfo(np.int64).min)
        self.leaf[ended] = ~self.next[ended]
        self.leaf[rejected] = REJECTED
        self.node[running] = np.where(self.next[running] < 0, -1, self.next[running])

    def evaluation(self, metric: Metric) -> Evaluation:
        """The outcomes."""
        error = np.full(len(self.leaf), np.inf)
        resolved = np.zeros(len(self.leaf), np.bool_)
        at_leaf = np.flatnonzero(self.leaf >= 0)
        if len(at_leaf):
            leaves = self.table.leaves
            predicted = np.array([(f.x_um / 1e3, f.y_um / 1e3, f.theta_urad / 1e6) for f in leaves])
            known = np.array([f.resolved for f in leaves])
            error[at_leaf] = metric.between(self.poses[at_leaf], predicted[self.leaf[at_leaf]])
            resolved[at_leaf] = known[self.leaf[at_leaf]]
        return Evaluation(
            self.leaf,
            self.squeezes,
            self.seconds,
            error,
            resolved,
            metric.distance_mm,
            self.crashes,
            self.poses,
        )

    def _count_crashes(self, world: World, hand: Array, opening_mm: float) -> None:
        collides = getattr(world, "collides", None)
        if collides is not None:
            reach = float(np.max(np.hypot(*self.job.part.outline_mm.T)))
            near = np.abs(hand[:, 1]) + reach > 0.5 * opening_mm
            self.crashes += sum(bool(collides(tuple(pose), opening_mm)) for pose in hand[near])

    def _spend(self, members: IntArray, squeeze: Squeeze, placement: Array, width: Array) -> None:
        """Adds the time of a squeeze: travel above the part, descent, closing, opening, ascent."""
        limits = self.table.limits
        travel = np.hypot(*(placement[:2] - self.hand[members]).T)
        lift = 2.0 * (limits.retreat_height_um - limits.squeeze_height_um) / 1e3
        stroke = 2.0 * (squeeze.opening_um / 1e3 - width)
        self.seconds[members] += (travel + lift) / (limits.arm_speed_um_s / 1e3)
        self.seconds[members] += stroke / (squeeze.speed_um_s / 1e3)
        self.hand[members] = placement[:2]


def _targets(node: Node, calibration: Calibration) -> IntArray:
    """Target of every count: a node, ~leaf, or the least integer for REJECT. (256,)."""
    rejected = int(np.iinfo(np.int64).min)
    outcome = count_map(node, calibration)
    return np.array([rejected if k == REJECT else node.branches[k].target for k in outcome], dtype=np.int64)


def _squeeze_all(world: World, hand: Array) -> tuple[Array, Array]:
    """Final poses (n, 3) and true widths (n,), in a batch where the world offers one."""
    many = getattr(world, "squeeze_many", None)
    if many is not None:
        rolled = many(hand)
        return cast(Array, rolled.poses), cast(Array, rolled.width_mm)
    results = [world.squeeze((float(x), float(y), float(theta))) for x, y, theta in hand]
    final = np.array([result[0] for result in results], dtype=np.float64).reshape(-1, 3)
    return final, np.array([result[1] for result in results], dtype=np.float64)
