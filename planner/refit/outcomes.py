"""What the parts of a cell show, as numbered outcomes: a count at a node, or a measured pose at a leaf."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.evaluation.judge import metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.frames import wrap
from runtime.table import COUNTS, Table, predicted_pose

EMPTY_UM = 2000  # widths up to that may be an empty hand's
STEP_MM = 0.1  # in which residuals of measured poses are told apart; as many steps as counts


class Seen(NamedTuple):
    """What a cell's journals hold."""

    readings: IntArray  # (nodes, 256) how often each count was read at each node
    parts: int  # how many parts were squeezed
    leaves: IntArray  # (m,) the leaves of audited parts
    residuals: Array  # (m, 3) measured less predicted poses there [mm, mm, rad]


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """Numbers of all outcomes of a table's parts, from 0 to `size` - 1; `size` stands for none.

    A count at a node is one outcome, and so is each of the three numbers of a residual at a leaf, in steps.
    Where a part lies is compared at leaves alone that were audited. 256 outcomes each are a row, those of
    the nodes first.
    """

    table: Table
    audited: BoolArray  # (leaves,)

    @property
    def size(self) -> int:
        """How many there are."""
        return COUNTS * (len(self.table.nodes) + 3 * int(self.audited.sum()))

    def of_parts(self, evaluation: Evaluation) -> IntArray:
        """Those of simulated parts, (n, d + 3): of their squeezes, then of their poses."""
        count = np.minimum(evaluation.counts, self._empty)
        read = np.where(evaluation.path < 0, self.size, COUNTS * evaluation.path + count)
        known = np.zeros(len(evaluation.leaf), np.bool_)
        known[evaluation.leaf >= 0] = self.audited[evaluation.leaf[evaluation.leaf >= 0]]
        lies = np.full((len(read), 3), self.size)
        if known.any():
            leaf = evaluation.leaf[known]
            predicted = np.array([predicted_pose(self.table.leaves[k]) for k in leaf])
            lies[known] = self._lying(leaf, evaluation.poses[known] - predicted)
        return np.column_stack([read, lies])

    def of_seen(self, seen: Seen) -> Array:
        """How often each (size,) is in journals."""
        read = COUNTS * np.arange(len(seen.readings))[:, None] + np.minimum(
            np.arange(COUNTS), self._empty
        )
        lies = self._lying(seen.leaves, seen.residuals)
        weights = np.concatenate([seen.readings.ravel(), np.ones(lies.size)])
        numbers = np.concatenate([read.ravel(), lies.ravel()])
        return np.bincount(numbers, weights, self.size).astype(np.float64)

    @property
    def _empty(self) -> int:
        """The count that all stand for that an empty hand may read.

        Some grippers' zero is a stop that no offset of the encoder moves, others' is not; it tells nothing.
        """
        gripper = self.table.gripper
        span = (gripper.count_closed - gripper.count_open) / gripper.opening_um
        return gripper.count_closed - round(EMPTY_UM * span)

    def _lying(self, leaf: IntArray, residuals: Array) -> IntArray:
        """Outcomes (m, 3) of residuals (m, 3) at leaves (m,)."""
        metric = metric_of_table(self.table)
        off = residuals.copy()
        off[:, 2] = metric.rho_mm * wrap(off[:, 2], metric.order)
        step = np.clip(np.rint(off / STEP_MM).astype(np.int64) + COUNTS // 2, 0, COUNTS - 1)
        row = len(self.table.nodes) + 3 * (np.cumsum(self.audited) - 1)[leaf]
        return COUNTS * (row[:, None] + np.arange(3)) + step
