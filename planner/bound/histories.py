"""Histories of a sample of parts under all plans at once, and how many parts a plan may locate after each.

Every part is squeezed at every placement that a plan might choose first, and after each of these squeezes
again at every placement. Parts with the same placements and readings so far share a history. After a history
a plan either squeezes at a next placement, or claims a pose: it predicts that the part lies there.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, IntArray
from planner.belief.metric import Metric
from planner.belief.particles import Belief
from planner.bound.cover import most_located
from planner.work.progress import Report, silent

READINGS = 1 << 22
"""Upper limit on readings; a reading is here twice the encoder's step, plus 1 if the object flag is set."""

Squeeze: TypeAlias = Callable[[Belief, Array, Generator], tuple[Array, IntArray]]
"""Squeezes n parts once: a belief, placements (n, 3) of the hand and a random generator give
poses (n, 3) in the world [mm, mm, rad] and readings (n,), 0 to `READINGS` - 1."""

History: TypeAlias = tuple[int, ...]
"""Two integers for each squeeze so far, in order: the number of the placement, and the reading."""

Placements: TypeAlias = Callable[[History], Array]
"""Gives the placements (k, 3), k >= 1, of the squeeze after a history.

They must not depend on the sample that proves the bound.
"""


class Level(NamedTuple):
    """All histories, sequences of squeezes and readings, of one length.

    A level has h histories, and o squeezes that lead to them from the histories one squeeze shorter.
    """

    size: IntArray  # (h,) number of parts of each history
    located: IntArray  # (h,) upper bound on the parts that one prediction locates
    option: IntArray  # (h,) the last squeeze of the history: an index into `owner` and `placement`
    reading: IntArray  # (h,) the reading of that squeeze
    owner: IntArray  # (o,) index of the history before the squeeze, in the level before
    placement: IntArray  # (o,) index of the placement, among all placements after that history

    def joined(self, more: "Level") -> "Level":
        """Returns a level with the histories of this level, then those of `more`.

        The squeezes of `more` get new numbers, which follow those of this level.
        """
        more = more._replace(option=more.option + len(self.owner))
        return Level(*(np.concatenate(columns) for columns in zip(self, more, strict=True)))


class Lying(NamedTuple):
    """Where the parts of a level's histories lie, grouped by history."""

    poses: Array  # (n, 3) [mm, mm, rad]
    part: IntArray  # (n,) index of each part in the sample
    start: IntArray  # (h + 1,) first row of each history, then n

    def of(self, histories: IntArray) -> tuple[IntArray, IntArray]:
        """Returns the rows (m,) of all parts that have one of the given histories.

        Also returns the index in `histories` of each row's history, (m,).
        """
        size = np.diff(self.start)[histories]
        before = np.cumsum(size) - size
        rows = np.arange(size.sum()) + np.repeat(self.start[histories] - before, size)
        return rows, np.repeat(np.arange(len(histories)), size)


class Depths(NamedTuple):
    """Limits on the lengths of histories, in squeezes."""

    tried: int  # length up to which all placements are tried
    most: int  # greatest length of any history


class Histories:
    """The histories of a sample of parts: all histories up to a length, and longer ones on request."""

    def __init__(
        self,
        squeeze: Squeeze,
        parts: Belief,
        metric: Metric,
        placements: Placements,
        depths: Depths,
        rng: Generator,
        workers: int | None = 1,
        report: Report = silent,
    ) -> None:
        """Squeezes the sample `parts` at all placements, in histories of up to `depths.tried` squeezes."""
        self._squeeze, self._placements = squeeze, placements
        self._parts, self._metric = parts, metric
        self._deepest, self._rng, self._workers, self._report = depths.most, rng, workers, report
        start, none = np.array([0, len(parts)]), np.zeros(0, np.int64)
        located = self._located(parts.poses, start)
        option, reading = np.zeros(1, np.int64), np.full(1, -1)
        self.levels = [Level(np.diff(start), located, option, reading, none, none)]
        self._lying = [Lying(parts.poses, np.arange(len(parts)), start)]
        for level in range(depths.tried):
            self.extend(level, np.arange(len(self.levels[level].size)))

    def history(self, level: int, number: int) -> History:
        """The placements and readings of history `number` of a level."""
        result: History = ()
        for longer in self.levels[level:0:-1]:
            option = longer.option[number]
            result = (int(longer.placement[option]), int(longer.reading[number]), *result)
            number = int(longer.owner[option])
        return result

    def extend(self, level: int, chosen: IntArray) -> None:
        """Squeezes the parts of some of a level's histories at all placements; stores the longer histories.

        Args:
            level: length of the histories to extend.
            chosen: numbers of these histories in the level; none may have been extended before.
        """
        choices = [self._placements(self.history(level, int(number))) for number in chosen]
        count = np.array([len(choice) for choice in choices])
        first = np.cumsum(count) - count
        placed = np.concatenate(choices)
        lying, columns, moved = self._lying[level], [], []
        rows, node = lying.of(chosen)
        for j in range(int(count.max())):
            self._report("bound", j, int(count.max()), f"squeeze {level + 1}")
            here = np.flatnonzero(count[node] > j)
            part = lying.part[rows[here]]
            parts = Belief.of(lying.poses[rows[here]], traits=self._parts.traits[part])
            after, seen = self._squeeze(parts, placed[first[node[here]] + j], self._rng)
            key = (first[node[here]] + j) * READINGS + seen
            order = np.argsort(key, kind="stable")
            after, key = after[order], key[order]
            begins = np.flatnonzero(np.diff(key, prepend=-1, append=-1))
            columns.append((np.diff(begins), self._located(after, begins), key[begins[:-1]]))
            if level + 1 < self._deepest:
                moved.append(Lying(after, part[order], begins))
        size, located, key = (np.concatenate(column) for column in zip(*columns, strict=True))
        option, reading = np.divmod(key, READINGS)
        placement = np.arange(len(placed)) - np.repeat(first, count)
        result = Level(size, located, option, reading, np.repeat(chosen, count), placement)
        if level + 1 == len(self.levels):
            self.levels.append(result)
            self._lying.append(_together(moved))
        else:
            self.levels[level + 1] = self.levels[level + 1].joined(result)
            self._lying[level + 1] = _together([self._lying[level + 1], *moved])

    def _located(self, poses: Array, start: IntArray) -> IntArray:
        """Returns upper bounds (k,): how many parts of each of k groups one answer can locate at most.

        An answer states `metric.modes` poses. Group i has the rows of `poses` from `start[i]` to `start[i +
        1]` - 1.
        """
        metric = self._metric
        most = most_located(poses, start, metric.weights(), metric.order, self._workers)
        return np.minimum(metric.modes * most, np.diff(start))


def _together(pieces: list[Lying]) -> Lying:
    """Concatenates several records to one, with the histories of each record after those before it."""
    if not pieces:
        return Lying(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(1, np.int64))
    poses, part, starts = zip(*pieces, strict=True)
    sizes = np.concatenate([np.diff(start) for start in starts])
    return Lying(np.concatenate(poses), np.concatenate(part), np.insert(np.cumsum(sizes), 0, 0))
