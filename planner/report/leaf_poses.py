"""Mean pose of the parts of each leaf in the stated cell, compared with the leaf's answer.

The stated cell has the values that the job states, without their uncertainty. The pose of a leaf is chosen
for all cells that the job believes possible, so in the stated cell it may differ from the mean on purpose.
"""

import math
from typing import NamedTuple

import numpy as np

from planner.evaluation.judge import metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.frames import wrap
from runtime.table import Table, predicted_pose

WORTH_TELLING_MM = 0.1  # an answer farther than this from the mean pose differs on purpose
LEAST_PARTS = 20  # fewer parts have no useful mean


class Mean(NamedTuple):
    """The mean pose of a leaf's parts in the stated cell."""

    x_mm: float
    y_mm: float
    theta_rad: float
    apart_mm: float  # distance from the leaf's pose, in the goal's metric

    @property
    def deliberate(self) -> bool:
        """Whether the leaf states a pose more than `WORTH_TELLING_MM` from the mean, chosen on purpose."""
        return self.apart_mm > WORTH_TELLING_MM


def means(table: Table, evaluation: Evaluation) -> list[Mean | None]:
    """Returns the mean pose of each leaf's parts.

    A part counts if it has the leaf's hypothesis and lies near the leaf's first pose, not at an alternative
    pose.
    The mean is None for an unresolved leaf, and for a leaf with fewer than `LEAST_PARTS` parts that count.
    """
    metric = metric_of_table(table)
    audit = metric._replace(kind="pose", distance_mm=metric.distance_mm or 1.0, identify=False)
    results: list[Mean | None] = []
    for index, leaf in enumerate(table.leaves):
        here = (evaluation.leaf == index) & (evaluation.traits["hypothesis"] == leaf.hypothesis)
        order = (metric.order, *(order for _, order in metric.further))[leaf.hypothesis]
        pose = np.array(predicted_pose(leaf))
        off = evaluation.poses[here] - pose
        off[:, 2] = wrap(off[:, 2], order)
        # Parts at an alternative pose of the leaf do not count for the mean at the first pose.
        state = np.array([*pose, leaf.hypothesis])
        numbers = np.full(len(off), leaf.hypothesis)
        near = audit.reached(np.column_stack([evaluation.poses[here], numbers]), state)
        if not leaf.resolved or near.sum() < LEAST_PARTS:
            results.append(None)
            continue
        mean = off[near].mean(axis=0)
        at = pose + mean
        apart = float(audit.between(np.array([*at, leaf.hypothesis]), state))
        x, y, theta = map(float, at)
        results.append(Mean(x, y, math.remainder(theta, math.tau), apart))
    return results
