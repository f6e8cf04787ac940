"""Upper bound on the number of poses that one prediction can locate, by branch and bound.

A prediction locates a pose if their distance d is less than the goal. `planner.belief.metric` climbs to a
good prediction, which proves nothing about the best one. Here a box that holds every prediction in question
is divided into smaller boxes, the cells. Let g be the middle of a cell and e the greatest distance from g to
a prediction in the cell. If a prediction q of the cell locates a pose p, then d(p, g) < goal + e, since d(p,
q) < goal and d(q, g) <= e. So no prediction of the cell locates more poses than lie within goal + e of g.
Cells that cannot beat the best prediction so far are dropped; the others are bisected until e is a hundredth
of the goal.

All distances are in units of the goal.
"""

from collections import deque
from itertools import pairwise

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.metric import largest_mode
from planner.kernel import kernel
from planner.work.scheduler import Threads

LEAST_SHARE = 0.75
"""Share of a group, above 0.5, below which the bound is not made tighter."""
INFLATION = 0.01  # radius at which a cell is no longer bisected; it widens the goal by as much
TOGETHER = 4096  # approximate number of poses that a thread covers at once
MOST_CELLS = 20000  # most cells visited; the bound holds wherever the search ends


def most_located(
    poses: Array, start: IntArray, weights: Array, order: int, workers: int | None = 1
) -> IntArray:
    """Bounds from above, for each group of poses, how many of its poses one prediction can locate.

    Args:
        poses: (n, 3) the groups one after the other [mm, mm, rad].
        start: (k + 1,) first row of each group, then n; no group is empty.
        weights: (1, 6) weights of the metric (`Metric.weights`).
        order: rotational order of the part.
        workers: threads that share the groups, all cores if None; the result does not depend on it.

    Returns:
        The bounds (k,). A bound is not made tighter than about `LEAST_SHARE` of its group.
    """
    result, poses = np.zeros(len(start) - 1, np.int64), np.ascontiguousarray(poses)
    pieces = np.unique(np.searchsorted(start, np.arange(0, len(poses), TOGETHER)))

    def run(piece: tuple[int, int]) -> None:
        first, last = piece
        _most_located(poses, start[first : last + 1], weights, order, result[first:last])

    threads = Threads(workers) if workers else Threads()
    deque(threads.map(run, list(pairwise([*pieces.tolist(), len(result)]))), maxlen=0)
    return result


@kernel
def _most_located(
    poses: Array, start: IntArray, weights: Array, order: int, located: IntArray
) -> None:
    """Does the work of `most_located` in one thread; writes the bounds into `located` (k,)."""
    largest, weights_of_part = 1, weights[0]
    for k in range(located.shape[0]):
        largest = max(largest, start[k + 1] - start[k])
    local = np.empty((largest, 3))
    column = np.empty(largest)
    stack = np.empty((64, 7))
    pose = np.empty(3)
    turn = weights_of_part[3] * 2.0 * np.pi / order
    for k in range(located.shape[0]):
        group = poses[start[k] : start[k + 1]]
        n = group.shape[0]
        least = int(np.ceil(LEAST_SHARE * n))
        located[k] = least - 1
        if _localise(
            group, weights_of_part, 2.0 * np.pi / order, least, local[:n], column[:n]
        ) and _enclosed(local[:n], column[:n], weights_of_part, turn, least, stack[0]):
            best = round(largest_mode(np.ascontiguousarray(group.T), n, weights, pose) * n)
            located[k] = n
            if best < n:
                located[k] = _search(
                    local[:n], weights_of_part[0] > 0.0, turn, max(best, least - 1), stack
                )


@kernel
def _localise(
    poses: Array, weights: Array, period: float, least: int, local: Array, column: Array
) -> bool:
    """Converts poses to units of the goal, and their angles to differences from the middle of a window.

    The window is an interval of angles, two goals wide. It is placed where it contains the most poses.

    Args:
        poses: (n, 3) the poses of a group [mm, mm, rad].
        weights: (6,) the single row of `Metric.weights`.
        period: period of the angle [rad].
        least: number of poses that a prediction must locate to matter; more than half of the n poses.
        local: receives the converted poses (n, 3).
        column: (n,) work space.

    Returns:
        Whether the window holds at least `least` poses. If so, the angle of every prediction that matters
        lies within two goals of the middle.
    """
    n = poses.shape[0]
    turn = weights[3] * period
    for i in range(n):
        local[i, 0], local[i, 1] = weights[1] * poses[i, 0], weights[2] * poses[i, 1]
        angle = weights[3] * poses[i, 2]
        column[i] = angle - turn * np.floor(angle / turn)
    column.sort()
    middle, most, stop = 0.0, 0, 0
    for i in range(n):
        while stop < i + n and column[stop % n] + turn * (stop // n) <= column[i] + 2.0:
            stop += 1
        if stop - i > most:
            most, middle = stop - i, column[i] + 1.0
    for i in range(n):
        angle = weights[3] * poses[i, 2] - middle
        local[i, 2] = angle - turn * np.round(angle / turn)
    return most >= least


@kernel
def _enclosed(
    local: Array, column: Array, weights: Array, turn: float, least: int, cell: Array
) -> bool:
    """Whether some prediction may locate `least` poses; if so, `cell` receives a box of all such predictions.

    Args:
        local: (n, 3) poses as `_localise` leaves them.
        column: (n,) work space.
        weights: (6,) the single row of `Metric.weights`.
        turn: the period of the angles, in units of the goal.
        least: number of poses that a prediction must locate to matter.
        cell: (7,) receives the middle and half the sides of the box, and n.
    """
    n = local.shape[0]
    for axis in range(2):
        for i in range(n):
            column[i] = local[i, axis]
        column.sort()
        # A prediction locates `least` poses less than one goal to either side.
        low, high = column[least - 1] - 1.0, column[n - least] + 1.0
        if low > high:
            return False
        cell[axis] = 0.5 * (low + high)
        cell[3 + axis] = 0.5 * (high - low) if weights[1 + axis] > 0.0 else 0.0
    cell[2], cell[5], cell[6] = 0.0, min(2.0, 0.5 * turn), n
    return True


@kernel
def _search(local: Array, added: bool, turn: float, best: int, stack: Array) -> int:
    """Bounds the number of poses that a prediction can locate, by branch and bound over cells of predictions.

    Args:
        local: (n, 3) poses as `_localise` leaves them.
        added: whether the metric adds the angle to the distance.
        turn: the period of the angles, in units of the goal.
        best: number of poses to beat, at least the number that a known prediction locates.
        stack: (m, 7) work space: middle and half the sides of each cell, and an upper bound on the poses that
            a prediction in it locates. The first row holds the first cell.

    Returns:
        The upper bound; at least `best`.
    """
    size, cells = 1, 0
    while size > 0:
        size -= 1
        if stack[size, 6] <= best:
            continue
        x, y, angle, a, b, c = stack[size, :6]
        radius = np.hypot(a, b) + c if added else max(a, b, c)
        if radius <= INFLATION or cells >= MOST_CELLS:
            best = max(best, int(stack[size, 6]))
            continue
        if a >= b and a >= c:
            a *= 0.5
            dx, dy, dz = a, 0.0, 0.0
        elif b >= c:
            b *= 0.5
            dx, dy, dz = 0.0, b, 0.0
        else:
            c *= 0.5
            dx, dy, dz = 0.0, 0.0, c
        radius = np.hypot(a, b) + c if added else max(a, b, c)
        cells += 2
        first = size
        for side in (-1.0, 1.0):
            middle = x + side * dx, y + side * dy, angle + side * dz
            inner, outer = _count(local, middle, added, turn, 1.0 + radius)
            best = max(best, inner)
            stack[size, 0], stack[size, 1], stack[size, 2] = middle
            stack[size, 3], stack[size, 4], stack[size, 5], stack[size, 6] = a, b, c, outer
            size += 1
        if stack[first, 6] > stack[first + 1, 6]:  # the more promising cell is visited first
            for j in range(7):
                stack[first, j], stack[first + 1, j] = stack[first + 1, j], stack[first, j]
    return best


@kernel
def _count(
    local: Array, middle: tuple[float, float, float], added: bool, turn: float, reach: float
) -> tuple[int, int]:
    """Counts the poses `local` (n, 3) within distance 1 of `middle`, and those within `reach`."""
    inner, outer = 0, 0
    for i in range(local.shape[0]):
        dx, dy = local[i, 0] - middle[0], local[i, 1] - middle[1]
        dz = abs(local[i, 2] - middle[2])
        dz = min(dz, abs(turn - dz))
        distance = np.sqrt(dx * dx + dy * dy) + dz if added else max(abs(dx), abs(dy), dz)
        if distance < reach:
            outer += 1
            if distance < 1.0:
                inner += 1
    return inner, outer
