"""Outcomes of the parts of a cell: counted alike from journals and from simulations."""

import numpy as np

from planner.evaluation.expectation import readings
from planner.frames import wrap
from planner.refit.cells import Cells
from planner.refit.outcomes import Outcomes, Seen
from runtime.table import predicted_pose


def test_outcomes_of_journal_and_simulation_are_equal(job, table):
    """The same parts are counted in two ways: as if a journal described them, and as a simulation gives them.

    In this cell the fingers meet 2 mm off the hand's middle. Two leaves are audited; a third of the parts
    that end there lies half a turn off the stated pose.
    """
    cells = Cells.of(job, table)
    values = {"middle_mm": 2.0, "finger_part_min": 0.4, "finger_part_max": 0.6}
    point = np.array([*(values.get(quantity.key, 0.0) for quantity in cells.space.quantities), 0.0])
    result = cells.run(point, 200, 3)
    audited = np.isin(np.arange(len(table.leaves)), result.leaf[result.leaf >= 0][:2])
    outcomes = Outcomes(table, audited)
    rows = np.flatnonzero((result.leaf >= 0) & audited[result.leaf])
    answers = [predicted_pose(table.leaves[leaf]) for leaf in result.leaf[rows]]
    off = result.poses[rows] - np.array(answers)
    off[:, 2] = wrap(off[:, 2], 2)
    off[::3, 2] += np.pi
    counts = readings(result, table)
    seen = outcomes.of_seen(Seen(counts, len(result.leaf), result.leaf[rows], off))
    shown = np.bincount(outcomes.of_parts(result).ravel(), minlength=outcomes.size + 1)
    assert np.array_equal(seen, shown[:-1])
    assert seen.sum() == counts.sum() + 3 * len(rows)
