"""What a healthy cell's encoder reads at each node of a table, and what it would read at another friction.

`grasp-audit report --expected` weighs the readings in journals by these shares.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import IntArray
from planner.evaluation.cases import friction_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

KIND, VERSION = "expected readings", 1


class World(NamedTuple):
    """What was read in one world."""

    name: str  # as planned, or what is different
    readings: IntArray  # (nodes, 256) how often each count was read at each node


def expected(
    table: Table, job: Job, trials: int, seed: int, scheduler: Scheduler, report: Report = silent
) -> Iterator[World]:
    """Runs a table in each world, with so many parts; the job is the one it was compiled from."""
    worlds = partial(ContactWorlds.of_job, seed=seed)
    for line in sweep(table, job, friction_cases(job), worlds, trials, seed, scheduler, report):
        yield World(line.case.name, readings(line.evaluation, len(table.nodes)))


def readings(found: Evaluation, nodes: int) -> IntArray:
    """How often each count was read at each node, (nodes, 256)."""
    made = found.path >= 0
    totals = np.bincount(256 * found.path[made] + found.counts[made], minlength=256 * nodes)
    return np.asarray(totals.reshape(nodes, 256), np.int64)


def document(digest: str, worlds: list[World], trials: int, seed: int) -> dict[str, Any]:
    """What the file holds: for each world and node the counts read and how often, others left out.

    `digest` is that of the table's file, as `runtime.table.load` tells it.
    """
    return {
        "kind": KIND,
        "version": VERSION,
        "table_sha256": digest,
        "trials": trials,
        "seed": seed,
        "worlds": [
            {"name": world.name, "readings": [_row(row) for row in world.readings]} for world in worlds
        ],
    }


def _row(row: IntArray) -> dict[str, int]:
    return {str(count): int(row[count]) for count in np.flatnonzero(row)}
