"""Parts sent through a table, with their poses kept: the beliefs that the table itself does not hold.

A table stores decisions only (paper, Fig. 2: "no belief distribution needs to be stored"). A picture of it
needs the beliefs again, and finds them as the table was judged: many parts, squeezed in the stochastic world,
each sent on by the encoder count it would read.
"""

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.observation import encoder_of
from planner.belief.particles import initial
from planner.evaluation.trials import Program, step
from planner.job.model import Job
from planner.world import ContactWorld
from runtime.table import Table


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """The parts that came to one node."""

    before: Array  # (n, 3) their poses in the world before the squeeze [mm, mm, rad]
    after: Array  # (n, 3) and after it, the jaws still closed
    released: Array  # (n, 3) where the jaws let go of them
    width_mm: Array  # (n,) true opening at which the fingers stopped
    counts: IntArray  # (n,) what the encoder reads of it
    branch: IntArray  # (n,) where the encoder's reading sends each, `REJECT` where it fits no branch

    def through(self, branch: int) -> Array:
        """Poses (m, 3) of the parts that leave through one branch, or through `runtime.table.REJECT`."""
        return np.asarray(self.released[self.branch == branch])


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """All parts, node by node."""

    visits: tuple[Visit, ...]  # one for each node of the table
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
        before = arrivals[index]
        at = np.full(len(before), index)
        made = step(program, at, before, program.placement[at], world, encoder, rng)
        visit = Visit(before, made.after, made.released, made.width_mm, made.counts, made.branch)
        visits.append(visit)
        for number, branch in enumerate(node.branches):
            if branch.target >= 0:
                arrivals[branch.target] = visit.through(number)
            else:
                leaves[~branch.target] = visit.through(number)
    return Replay(tuple(visits), tuple(leaves))
