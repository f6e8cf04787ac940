"""Parts sent through a table, with their poses kept: the beliefs that the table itself does not hold.

They are found as the table was judged: many parts, squeezed in the stochastic world, each sent on by the
encoder count it would read.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.belief.particles import initial
from planner.evaluation.trials import Program, Step, step
from planner.job.model import Job
from planner.world import ContactWorld
from runtime.table import Table


class Replay(NamedTuple):
    """All parts, node by node."""

    visits: tuple[Step, ...]  # one for each node of the table
    leaves: tuple[Array, ...]  # for each leaf, the poses (m, 3) of the parts that ended there


def replay(table: Table, job: Job, trials: int, seed: int) -> Replay:
    """Sends parts through the table of a job; the seed is that of poses, mechanics and encoder's noise."""
    rng = np.random.default_rng([seed, 0x5245504C])
    world, encoder = ContactWorld(job, seed), encoder_of(job)
    program = Program.of(table)
    arrivals = [np.empty((0, 3))] * len(table.nodes)
    leaves = [np.empty((0, 3))] * len(table.leaves)
    arrivals[0] = initial(job, trials, rng)
    visits = []
    for index, node in enumerate(table.nodes):  # each comes after the one that leads to it
        at = np.full(len(arrivals[index]), index)
        made = step(program, at, arrivals[index], program.placement[at], world, encoder, rng)
        visits.append(made)
        for number, branch in enumerate(node.branches):
            if branch.target >= 0:
                arrivals[branch.target] = made.through(number)
            else:
                leaves[~branch.target] = made.through(number)
    return Replay(tuple(visits), tuple(leaves))
