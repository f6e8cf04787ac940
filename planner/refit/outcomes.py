"""Gives outcomes of parts numbers, to compare the outcomes in journals with those of simulated parts.

An outcome is a reading at a node or, at an audited leaf, a coordinate of a residual. A residual is the
measured less the predicted pose of a part.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.evaluation.expectation import bins_of
from planner.evaluation.judge import metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.frames import wrap
from runtime.table import Table, predicted_pose

EMPTY_UM = 2000  # widest reading of an empty hand [um]
LINE = 250  # number of steps of each coordinate of a residual
STEP_MM = 0.1  # size of a step


class Seen(NamedTuple):
    """Observations in a cell's journals."""

    readings: IntArray  # (nodes, bins) count of each bin at each node
    parts: int  # number of parts that were squeezed
    leaves: IntArray  # (m,) the leaves of audited parts
    residuals: Array  # (m, 3) measured less predicted poses of these parts [mm, mm, rad]


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """Gives each outcome of a table's parts a number from 0 to `size` - 1; `size` stands for no outcome.

    Readings at a node are sorted into bins, and each bin is an outcome. At an audited leaf, x, y and theta of
    a residual are rounded to `LINE` steps each, and each step is an outcome. The bins of all nodes are
    numbered first, node by node, then the steps, leaf by leaf and coordinate by coordinate.
    """

    table: Table
    audited: BoolArray  # (leaves,) whether a leaf was audited

    @property
    def size(self) -> int:
        """Number of outcomes."""
        return self._read + LINE * 3 * int(self.audited.sum())

    @property
    def _read(self) -> int:
        """Number of outcomes that are readings."""
        return self.table.gripper.bins * len(self.table.nodes)

    def of_parts(self, evaluation: Evaluation) -> IntArray:
        """Returns the outcome numbers (n, d + 3) of n simulated parts.

        The first d numbers of a part are for its squeezes, the last three for x, y and theta of its residual.
        """
        bins = np.maximum(bins_of(self.table, evaluation.steps), self._empty)
        place = self.table.gripper.bins * evaluation.path + bins
        read = np.where(evaluation.path < 0, self.size, place)
        known = np.zeros(len(evaluation.leaf), np.bool_)
        known[evaluation.leaf >= 0] = self.audited[evaluation.leaf[evaluation.leaf >= 0]]
        lies = np.full((len(read), 3), self.size)
        if known.any():
            leaf = evaluation.leaf[known]
            predicted = np.array([predicted_pose(self.table.leaves[k]) for k in leaf])
            lies[known] = self._lying(leaf, evaluation.poses[known] - predicted)
        return np.column_stack([read, lies])

    def of_seen(self, seen: Seen) -> Array:
        """Number of observations (size,) of each outcome in journals."""
        bins = self.table.gripper.bins
        read = bins * np.arange(len(seen.readings))[:, None]
        read = read + np.maximum(np.arange(bins), self._empty)
        lies = self._lying(seen.leaves, seen.residuals)
        weights = np.concatenate([seen.readings.ravel(), np.ones(lies.size)])
        numbers = np.concatenate([read.ravel(), lies.ravel()])
        return np.bincount(numbers, weights, self.size).astype(np.float64)

    @property
    def _empty(self) -> int:
        """The bin that stands for all readings that an empty hand may have.

        The differences between these readings carry no information: some grippers read 0 with closed jaws
        whatever the encoder's offset is, others do not.
        """
        return self.table.gripper.bin_of(EMPTY_UM)

    def _lying(self, leaf: IntArray, residuals: Array) -> IntArray:
        """Returns the outcome numbers (m, 3) of x, y and theta of m residuals (m, 3) [mm, mm, rad].

        `leaf` (m,) has the audited leaf of each residual.
        """
        metric = metric_of_table(self.table)
        off = residuals.copy()
        off[:, 2] = metric.rho_mm * wrap(off[:, 2], metric.order)
        step = np.clip(np.rint(off / STEP_MM).astype(np.int64) + LINE // 2, 0, LINE - 1)
        row = 3 * (np.cumsum(self.audited) - 1)[leaf]
        return self._read + LINE * (row[:, None] + np.arange(3)) + step
