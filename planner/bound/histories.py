"""What a sample of parts does under every plan at once: the histories of readings, and how they may end.

A part is squeezed at every placement that a plan might choose, and again at every placement after each of
these. Parts with the same placements and readings so far share a history; a plan is a choice of one
placement, or of a pose to claim, for each.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.metric import Metric
from planner.bound.cover import most_located
from planner.work.progress import Report, silent

READINGS = 512  # a reading is an encoder count, and 256 more where the jaws feel a part


REPEATED = 4  # how often a part's last width is read: it counts as a quarter of a part with each reading


Squeeze: TypeAlias = Callable[[Array, Array, int, np.random.Generator], tuple[Array, IntArray]]
"""Squeezes n parts once: poses (n, 3) in the world [mm, mm, rad], placements (n, 3) of the hand, one each,
how often widths are read, source of randomness -> poses (n, 3), (times, n) readings, 0 to `READINGS` - 1."""


class Level(NamedTuple):
    """The histories of one length."""

    size: IntArray  # (h,) parts that have each, times `times`
    located: IntArray  # (h,) at most how many of them one prediction locates, likewise
    option: IntArray  # (h,) which of the placements that end the histories one squeeze shorter led to it
    times: int = 1  # how often each part was read
    # (h,) where its own placements begin among those of its level; empty at the last level.
    first: IntArray = np.zeros(0, np.int64)


Placements = Callable[[int, int, int], Array]
"""The placements (k, 3), k >= 1, of the next squeeze after so many, where the last was made at that placement
of its level, and read that. They must not depend on the sample."""


def gather(
    squeeze: Squeeze, poses: Array, metric: Metric, placements: Placements, depth: int,
    rng: np.random.Generator, report: Report = silent,
) -> list[Level]:  # fmt: skip
    """The histories of a sample of parts at poses (n, 3), from none to `depth` squeezes.

    Returns:
        depth + 1 levels, the first of one history.
    """
    start, reading = np.array([0, len(poses)]), np.array([-1])
    levels = [Level(np.diff(start), _located(poses, start, metric), np.zeros(1, np.int64))]
    for done in range(depth):
        histories = zip(levels[-1].option, reading, strict=True)
        choices = [placements(done, int(option), int(last)) for option, last in histories]
        count = np.array([len(choice) for choice in choices])
        first = np.cumsum(count) - count
        levels[-1] = levels[-1]._replace(first=first)
        node = np.repeat(np.arange(len(count)), np.diff(start))
        times = REPEATED if done == depth - 1 else 1
        columns, moved = [], []
        for j in range(int(count.max())):
            report("bound", j, int(count.max()))
            rows = np.flatnonzero(count[node] > j)
            at = np.array([choice[min(j, len(choice) - 1)] for choice in choices])[node[rows]]
            after, seen = squeeze(poses[rows], at, times, rng)
            key = ((first[node[rows]] + j) * READINGS + seen).ravel()
            order = np.argsort(key, kind="stable")
            after, key = after[order % len(rows)], key[order]
            begins = np.flatnonzero(np.diff(key, prepend=-1, append=-1))
            columns.append((np.diff(begins), _located(after, begins, metric), key[begins[:-1]]))
            if done < depth - 1:
                moved.append(after)
        size, located, history = (np.concatenate(column) for column in zip(*columns, strict=True))
        option, reading = np.divmod(history, READINGS)
        levels.append(Level(size, located, option, times))
        poses, start = np.concatenate([poses[:0], *moved]), np.cumsum(np.insert(size, 0, 0))
    return levels


def _located(poses: Array, start: IntArray, metric: Metric) -> IntArray:
    """At most how many parts of each group a claim locates; one of several modes names as many poses."""
    most = most_located(poses, start, metric.weights(), metric.order)
    return np.minimum(metric.modes * most, np.diff(start))
