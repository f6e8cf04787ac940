"""What a healthy cell's encoder reads at each node of a table, and what it would read at another friction.

`grasp-audit report --expected` weighs the readings in journals by these shares: a change of friction then
shows in a few dozen parts, often before any part is lost by it, and is called by its name.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import IntArray
from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import Evaluation
from planner.evaluation.sweep import Case, friction
from planner.evaluation.worlds import supply
from planner.job.model import Job
from planner.job.overrides import job_with
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.table import Table

KIND, VERSION = "expected readings", 1
PLANNED = "as planned"
# Of the friction between finger and part. Each world takes its share of the false alarms, so that one more
# makes the others slower; the outermost tell soon enough of a friction that lies farther away.
FACTORS = (0.5, 0.7, 1.15, 1.3, 1.6)
BEYOND = {min(FACTORS): " or less", max(FACTORS): " or more"}


class World(NamedTuple):
    """What was read in one world.

    Attributes:
        name: as planned, or what is different.
        readings: (nodes, 256) how often each count was read at each node.
    """

    name: str
    readings: IntArray


def cases(job: Job) -> list[Case]:
    """The worlds: as planned, then with less and with more friction, the planned interval times a factor."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    others = ((factor, friction(round(low * factor, 6), round(high * factor, 6))) for factor in FACTORS)
    return [Case(PLANNED), *(case._replace(name=case.name + BEYOND.get(f, "")) for f, case in others)]


def expected(
    table: Table, job: Job, trials: int, seed: int, scheduler: Scheduler, report: Report = silent
) -> Iterator[World]:
    """Runs a table in each world.

    Args:
        table: the table.
        job: it was compiled from.
        trials: parts in each world.
        seed: of the trials.
        scheduler: does the work.
        report: told of the progress.
    """
    for case in cases(job):
        real = job_with(job.canonical(), case.overrides, case.name)
        world = supply(DEFAULT_WORLD, real, seed)
        found = evaluate(table, real, world, trials, seed, scheduler, report=report)
        yield World(case.name, readings(found, len(table.nodes)))


def readings(found: Evaluation, nodes: int) -> IntArray:
    """How often each count was read at each node, (nodes, 256)."""
    made = found.path >= 0
    totals = np.bincount(256 * found.path[made] + found.counts[made], minlength=256 * nodes)
    return np.asarray(totals.reshape(nodes, 256), np.int64)


def document(digest: str, worlds: list[World], trials: int, seed: int) -> dict[str, Any]:
    """What the file holds: for each world and node the counts read and how often, others left out.

    Args:
        digest: of the table's file, as `runtime.table.load` tells it.
        worlds: what was read in each.
        trials: parts in each.
        seed: of the trials.
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
