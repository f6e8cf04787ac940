"""The public Python interface of the planner: arrays in, arrays out. See tools/docs/python.md."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from planner import arguments
from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import encoder_of
from planner.belief.particles import Belief
from planner.belief.transition import Outcomes, Simulation
from planner.compile import EVALUATION_TRIALS, Plan
from planner.compile import compile_job as compile  # noqa: A004 - what it is called everywhere else
from planner.evaluation import evaluate as trials_of
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import DISMISSED, Program
from planner.job.model import Job, from_canonical
from planner.mechanics.simulator import Simulator
from planner.pomdp import Pomdp
from planner.problem import Problem
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Threads
from planner.world import ContactWorld, ContactWorlds, World, Worlds
from runtime import table as tables
from runtime.shell.errors import InputError

__all__ = ["Belief", "ContactWorld", "Job", "Limit", "Plan", "Pomdp", "Simulator", "Table", "World"]
__all__ += ["compile", "evaluate", "squeeze"]


class Next(NamedTuple):
    """Where n widths lead: to nodes or leaves. Both are -1 where a width fits no branch (REJECT)."""

    nodes: IntArray  # (n,) index of the node of the next squeeze, or -1
    leaves: IntArray  # (n,) index of the leaf that is the answer, or -1


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A decision table of N nodes and L leaves as arrays; node 0 is the first squeeze."""

    record: tables.Table  # the runtime's record
    program: Program  # the nodes of the record as arrays

    @classmethod
    def of(cls, record: tables.Table) -> Self:
        """Converts a record of the runtime, such as `Plan.table`, to arrays."""
        return cls(record, Program.of(record))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Reads and validates a table's file.

        Raises:
            TableError: the file is missing, unreadable or invalid.
        """
        return cls.of(tables.load(path).table)

    def save(self, path: str | Path) -> None:
        """Writes the table's file atomically; raises `OutputError` if it cannot be written."""
        tables.dump(self.record, path)

    @property
    def job(self) -> Job:
        """The job that the table was compiled from; raises `InputError` if the table was stripped of it."""
        if self.record.job is None:
            raise InputError("the table carries no job; pass the one it was compiled from")
        return from_canonical(self.record.job, "the table's job")

    @property
    def placements(self) -> Array:
        """Where the hand squeezes at each node (N, 3): x, y [mm] and theta [rad] in the world."""
        return self.program.placement

    @property
    def poses(self) -> Array:
        """Where the part lies at each leaf (L, 3): x, y [mm] and theta [rad] in the world."""
        return np.array([tables.predicted_pose(leaf) for leaf in self.record.leaves])

    @property
    def resolved(self) -> BoolArray:
        """Whether each leaf (L,) is resolved: the table claims to know the pose of parts that end there."""
        return np.array([leaf.resolved for leaf in self.record.leaves])

    def lookup(self, nodes: IntArray, widths_mm: Array) -> Next:
        """Looks up the node or leaf to which a width (n,) [mm] leads when it is read at a node (n,).

        The object flag is not known here: a width leads where it does with an object felt, or else, if it
        fits no branch then, where it does without.

        Raises:
            ValueError: a node is unknown, a width is out of range, or the arrays differ in length.
        """
        nodes = arguments.indices(nodes, "nodes", len(self.record.nodes))
        opening_mm = self.record.gripper.opening_um / 1e3
        widths_mm = arguments.rows(widths_mm, "widths", least=0.0, most=opening_mm)
        arguments.same_length(nodes=nodes, widths=widths_mm)
        width_um = np.rint(1e3 * widths_mm).astype(np.int64)
        lookup, target = self.program.lookup, self.program.target
        unfelt, felt = (target[lookup.segment(2 * nodes + flag, width_um)] for flag in (0, 1))
        result = np.where(felt == DISMISSED, unfelt, felt)
        leaves = np.where((result < 0) & (result != DISMISSED), ~result, -1)
        return Next(np.maximum(result, -1), leaves)


def evaluate(
    table: Table,
    job: Job | None = None,
    world: World | Worlds | None = None,
    trials: int = EVALUATION_TRIALS,
    seed: int = 0,
    workers: int | None = None,
    report: Report = silent,
) -> Evaluation:
    """Runs a table on many parts, as `plan-evaluate` does.

    Args:
        table: the table.
        job: the true parts and gripper; None: the job of the table.
        world: squeezes the parts; None: a contact world, which draws the mechanics of each squeeze.
        trials: number of parts.
        seed: seed of all random numbers, except the random numbers of a `world` that is passed in.
        workers: number of threads; None: one for each core. The result does not depend on it.
        report: progress callback; an exception that it raises ends the evaluation.

    Returns:
        The results, one row for each part; their `summary()` states the figures for all parts.

    Raises:
        ValueError: trials, seed or workers are out of range.
        InputError: no job is passed, and the table was stripped of its job.
    """
    arguments.count(trials, "trials")
    arguments.count(seed, "seed", 0, 2**63 - 1)
    job = job or table.job
    worlds = ContactWorlds.of_job(job, seed) if world is None else world
    threads = Threads() if workers is None else Threads(arguments.count(workers, "workers"))
    return trials_of.evaluate(table.record, job, worlds, trials, seed, threads, report=report)


def squeeze(
    job: Job, belief: Belief, placement: Array, rng: np.random.Generator, workers: int | None = None
) -> Outcomes:
    """Squeezes the particles of a belief, and partitions them by the widths read.

    Args:
        job: states gripper, friction and goal.
        belief: the particles before the squeeze.
        placement: pose (3,) of the hand in the world [mm, mm, rad].
        rng: draws the mechanics and the noise of the encoder.
        workers: number of threads; None: one for each core.

    Returns:
        The outcomes: their `beliefs` are the particles of each of k clusters of widths, their `probability`
        (k,) is the share of each cluster. Widths rise from cluster to cluster.

    Raises:
        ValueError: the belief is empty or not (n, 3), the placement not (3,), or a number is not finite.
    """
    arguments.rows(belief.poses, "poses of the belief", 3)
    arguments.count(len(belief), "size of the belief")
    arguments.same_length(poses=belief.poses, traits=belief.traits, readings=belief.reading)
    model = Simulation(Simulator.of_job(job, workers), encoder_of(job))
    squeezed = model.squeeze([(belief, arguments.row(placement, "placement", 3))], rng)[0]
    return Outcomes.of(squeezed, Problem.of(job).rule)
