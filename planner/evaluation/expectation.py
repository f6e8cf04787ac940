"""Counts the readings to expect at each node of a table, in a healthy cell and at other frictions.

`grasp-audit report --expected` compares the readings in journals with these counts.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from planner.arrays import IntArray
from planner.evaluation.cases import friction_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.table import Table


def expected(
    table: Table, job: Job, trials: int, seed: int, scheduler: Scheduler, report: Report = silent
) -> Iterator[dict[str, Any]]:
    """Yields for each of `friction_cases` its "name", and a histogram of the "readings" at each node."""
    for case, result in sweep(table, job, friction_cases(job), trials, seed, scheduler, report):
        rows = readings(result, table)
        lines = [{str(number): int(row[number]) for number in np.flatnonzero(row)} for row in rows]
        yield {"name": case.name, "readings": lines}


def readings(evaluation: Evaluation, table: Table) -> IntArray:
    """Histograms (nodes, bins) of an evaluation's readings at each node of the table."""
    squeezed = evaluation.path >= 0
    histograms = np.zeros((len(table.nodes), table.gripper.bins), np.int64)
    bins = bins_of(table, evaluation.steps[squeezed])
    np.add.at(histograms, (evaluation.path[squeezed], bins), 1)
    return histograms


def bins_of(table: Table, steps: IntArray) -> IntArray:
    """Index of the histogram bin of each reading; `steps` holds readings, in steps of closing."""
    gripper = table.gripper
    return np.asarray((gripper.steps - steps) // gripper.steps_a_bin)
