"""How likely the readings of a cell's parts are in another cell, by parts simulated there.

A reading's probability is taken to depend on those before it through the node that they led to alone:
P(counts) = product over squeezes of P(count | node). A node stands for the branches that led there, so what
is left out is where within its branch each count lay.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import convolve1d, gaussian_filter1d

from planner.arrays import Array, IntArray
from planner.evaluation.expectation import readings
from planner.evaluation.judge import metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.frames import wrap
from runtime.table import COUNTS, Table, predicted_pose

NEAR = (0.08, 0.84, 0.08)  # a count's share of the two beside it
BROAD = 1.0  # standard deviation, in counts, by which readings of all cells are smoothed
USUAL_WEIGHT = 10.0  # readings that those of all cells count for, beside a cell's own
EVERYWHERE = 3.0  # and those of all nodes, beside all cells' at one node
STRANGE = 1e-3  # share of readings that nothing explains
EMPTY_UM = 2000  # widths up to that may be an empty hand's
BLUR_MM = 0.4  # by which simulated poses are blurred, to compare with measured ones


class Seen(NamedTuple):
    """What a cell's journals hold."""

    readings: IntArray  # (nodes, 256) how often each count was read at each node
    parts: int  # how many parts were squeezed
    leaves: IntArray  # (m,) the leaves of audited parts
    residuals: Array  # (m, 3) measured less predicted poses there [mm, mm, rad]


def pooled(counts: IntArray, table: Table) -> IntArray:
    """Readings (nodes, 256) in which all that an empty hand may read is one count.

    Some grippers' zero is a stop that no offset of the encoder moves, others' is not; it tells nothing.
    """
    gripper = table.gripper
    first = gripper.count_closed - round(
        EMPTY_UM * (gripper.count_closed - gripper.count_open) / gripper.opening_um
    )
    empty = np.array(counts)
    empty[:, first + 1 :] = 0
    empty[:, first] = counts[:, first:].sum(axis=1)
    return empty


def usual(counts: IntArray, table: Table) -> Array:
    """What each node reads in any cell: shares (nodes, 256), of readings (nodes, 256) in many cells."""
    simulated = pooled(counts, table).astype(np.float64)
    everywhere = gaussian_filter1d(simulated.sum(axis=0) + 1.0, BROAD, mode="nearest")
    shares = gaussian_filter1d(simulated, BROAD, axis=1, mode="nearest")
    shares += EVERYWHERE * everywhere / everywhere.sum()
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def log_likelihood(seen: Seen, found: Evaluation, table: Table, expected: Array) -> float:
    """Logarithm of the probability of what was seen, in the cell that these trials were run in.

    Where few trials came, `expected` stands in: what is `usual` at each node. The logarithm of a simulated
    count k is too low by 1 / (2 k) in the mean, which would favour cells whose parts read few counts.
    """
    simulated = pooled(readings(found, len(table.nodes)), table).astype(np.float64)
    near = convolve1d(simulated, NEAR, axis=1, mode="nearest") + USUAL_WEIGHT * expected
    shares = (1.0 - STRANGE) * near / near.sum(axis=1, keepdims=True) + STRANGE / COUNTS
    logarithms = np.log(shares) + 0.5 / (near + 1.0)
    total = float((pooled(seen.readings, table) * logarithms).sum())
    return total + sum(_of_residuals(seen, found, table, leaf) for leaf in np.unique(seen.leaves))


def _of_residuals(seen: Seen, found: Evaluation, table: Table, leaf: int) -> float:
    """Logarithm of the density of the audited poses at one leaf, by a kernel estimate (one for each mm^3)."""
    metric = metric_of_table(table)
    scale = np.array([1.0, 1.0, metric.rho_mm])
    off = found.poses[found.leaf == leaf] - np.array(predicted_pose(table.leaves[leaf]))
    off[:, 2] = wrap(off[:, 2], metric.order)
    gaps = (seen.residuals[seen.leaves == leaf][:, None] - off[None]) * scale
    weights = np.exp(-0.5 * (gaps**2).sum(axis=2) / BLUR_MM**2) / (2.0 * np.pi * BLUR_MM**2) ** 1.5
    anywhere = STRANGE / metric.distance_mm**3
    return float(np.log((weights.sum(axis=1) + anywhere) / (len(off) + 1.0)).sum())
