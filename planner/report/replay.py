"""Replay: runs parts through a table and keeps their poses, as the beliefs of the table's nodes.

As in an evaluation, the parts are squeezed in the stochastic world, and each takes the branch of its reading.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.doubts import hypotheses_of
from planner.belief.particles import initial
from planner.evaluation.disturbance import NONE
from planner.evaluation.trials import Cell, Program, Step
from planner.job.model import Job
from planner.mechanics.traits import with_hypothesis
from planner.world import ContactWorld, world_of
from runtime.table import Table


class Replay(NamedTuple):
    """The squeezes of all parts at each node, and the states of the parts at each node and leaf."""

    visits: tuple[Step, ...]  # one for each node of the table
    # For each node, the states of its parts before its squeeze and after its pushes, see `with_hypothesis`.
    arrivals: tuple[Array, ...]
    leaves: tuple[Array, ...]  # for each leaf, the states of the parts that ended there


def replay(table: Table, job: Job, trials: int, seed: int) -> Replay:
    """Runs `trials` parts through a table and records their states at each node and leaf.

    The same seed gives the same parts and squeezes.
    """
    rng = np.random.default_rng([seed, 0x5245504C])
    program = Program.of(table)
    cell = Cell(program, job, world_of(job, seed, ContactWorld), NONE, rng)
    arrivals = [np.empty((0, 3))] * len(table.nodes)
    leaves = [np.empty((0, 3))] * len(table.leaves)
    traits = [hypotheses_of(job, 0, rng)] * len(table.nodes)
    arrivals[0], traits[0] = initial(job, trials, rng), hypotheses_of(job, trials, rng)
    visits = []
    for index, node in enumerate(table.nodes):  # each node comes after the one that leads to it
        at = np.full(len(arrivals[index]), index)
        arrivals[index], _ = cell.pushed(at, arrivals[index], traits[index])
        after = cell.squeezed(at, arrivals[index], program.placement[at], traits[index])
        visits.append(after)
        for number, branch in enumerate(node.branches):
            poses, latent = after.through(number), traits[index][after.branch == number]
            if branch.target >= 0:
                arrivals[branch.target], traits[branch.target] = poses, latent
            else:
                leaves[~branch.target] = with_hypothesis(poses, latent)
    return Replay(tuple(visits), tuple(map(with_hypothesis, arrivals, traits)), tuple(leaves))
