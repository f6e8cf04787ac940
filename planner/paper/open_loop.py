"""Algorithms 2 and 3 of the paper, OpenLoopSearch and OpenLoopSearchBFSExpand, as printed.

The search goes through sequences of actions, breadth first, and ignores the outcomes of squeezes. The paper
leaves four points open, which are decided here as follows:

- "while subtree depth < d" bounds the expansion: sequences of length d are judged, but not expanded.
- Of sequences of equal singleton ratio the first is the result. The empty sequence does not compete: the
  result has an action even if every action lowers the ratio. The result is empty only if each action collides
  or is pruned.
- Algorithm 3 keeps a successor whose ratio r is above alpha E.r, where E is the expanded element. The text
  of section VI drops a successor whose ratio is below alpha E.r. The two rules differ where both ratios are
  0, as for a belief of two modes. There the printed algorithm would end the tree at once, so the rule of the
  text is used.
- CollisionFree tests the whole belief. A learned detector errs, so a placement counts as free up to a share
  of collisions (`COLLIDING_SHARE`).
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.random import Generator

from planner.arrays import Array
from planner.frames import to_hand, to_world
from planner.paper.sensor import Collides

Motion: TypeAlias = Callable[[Array, Generator], Array]
"""ForwardMotionModel-KCDE: draws final poses for initial ones, both (n, 3) in the hand frame."""
ALPHA = 0.75
"""Share of its singleton ratio that a sequence must keep when an action is added; else it is pruned."""
COLLIDING_SHARE = 0.005
"""Share of the belief that may lie under an open finger of a collision-free action."""


class Sequence(NamedTuple):
    """A sequence of actions, and the singleton ratio that it achieves."""

    actions: tuple[int, ...]  # indices of placements; empty if each action collides or is pruned
    ratio: float  # singleton ratio of the belief afterwards


class _Element(NamedTuple):
    """An element of the queue of a search: a sequence of actions and the belief after it.

    `poses` (n, 3) is empty if the element will not be expanded.
    """

    poses: Array
    ratio: float
    actions: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoop:
    """The search for a sequence of actions."""

    placements: Array  # (k, 3) the actions: the hand frame in the world
    motion: Motion  # forward motion model
    collides: Collides  # collision detector
    ratio: Callable[[Array], float]  # singleton ratio of a belief (n, 3)
    depth: int  # d, the length of the longest sequence
    enough: float = math.inf  # a sequence above this ratio ends the search
    budget: float = math.inf  # most beliefs to expand, instead of the paper's time limit

    def search(self, poses: Array, rng: Generator) -> Sequence:
        """Finds the sequence of largest ratio for particles (n, 3) in the world: Algorithm 2 up to a*."""
        queue = deque([_Element(poses, self.ratio(poses), ())])
        best, expanded = Sequence((), -np.inf), 0
        while queue and best.ratio <= self.enough:
            element = queue.popleft()
            if element.actions and element.ratio > best.ratio:
                best = Sequence(element.actions, element.ratio)
            if len(element.actions) < self.depth and expanded < self.budget:
                queue.extend(self._expand(element, rng))
                expanded += 1
        return best

    def free(self, poses: Array, placement: Array) -> bool:
        """Whether the hand can be set down at a placement (3,) without collision.

        Nearly all of the believed poses (n, 3) have to be free of collision.
        """
        return bool(self.collides(to_hand(poses, placement)).mean() <= COLLIDING_SHARE)

    def moved(self, poses: Array, placement: Array, rng: Generator) -> Array:
        """Poses (n, 3) in the world after an action: ForwardMotionModel-KCDE(X, a)."""
        return to_world(self.motion(to_hand(poses, placement), rng), placement)

    def _expand(self, element: _Element, rng: Generator) -> Iterator[_Element]:
        """Yields the successors of an element that are free of collision and not pruned: Algorithm 3."""
        last = len(element.actions) + 1 == self.depth
        for action, placement in enumerate(self.placements):
            if not self.free(element.poses, placement):
                continue
            poses = self.moved(element.poses, placement, rng)
            ratio = self.ratio(poses)
            if ratio >= ALPHA * element.ratio:
                # The last level is only judged; keeping its beliefs would fill the memory.
                yield _Element(poses[:0] if last else poses, ratio, (*element.actions, action))
