"""Search within a limit of time.

The careful search expands the leaves that hold most parts, all over the tree: nearly all leaves stay open
until nearly all the work is done, and a tree cut short half-way locates hardly a part. So under a budget a
whole tree is grown hastily first, in a fraction of the time, and the careful one takes its place once it is
whole and turns out better.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from planner.search.expand import Growth, Progress, TreeNode, breadth_first, grow, untold
from planner.search.hasty import grow_hastily, squeeze_first
from planner.work.limit import Limit

MENDING = 0.5  # Time to mend a hasty tree in which other squeezes were tried, in units of its growth
COMPLETING = 0.5  # Time to grow what a careful growth left open, and to refine it, in units of that growth
CAREFUL = 5.0  # Time of the careful growth in units of the hasty one
AFTER_GROWTH = 0.75  # Time of improvement and refinement in units of the growth before them
LEAST_DONE = 0.02  # Share of the growth from which its rate is believed


class Cut(NamedTuple):
    """How a search was cut short."""

    asked: bool  # by a request; else by the budget
    open_share: float  # of all parts, those that end in leaves which are not resolved
    seconds: float  # that the rest of the search would take, estimated

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "by": "interrupt" if self.asked else "budget",
            "open_share": round(self.open_share, 6),
            "seconds_to_finish": math.ceil(self.seconds),
        }

    def line(self) -> str:
        """For people."""
        cause = "request" if self.asked else "the budget"
        return (
            f"CUT SHORT by {cause}: {self.open_share:.2%} of the parts end where the search is not done; "
            "how long the rest of it takes is not known"
        )


@dataclass(slots=True, eq=False)
class Anytime:
    """The growth of one tree within a limit."""

    growth: Growth
    limit: Limit
    hasty: bool = False
    tight: bool = False  # whether its evaluations would take much of the budget
    begun_s: float = 0.0  # when its growth began, on the limit's clock
    growth_s: float = 0.0  # how long the growth took, or would have taken by estimate
    cut: bool = False  # whether something was left undone

    def grow(self, root: TreeNode, seed: list[int], progress: Progress, first: Progress = untold) -> None:
        """Grows a tree from its root; a hasty one with little effort, more where that gains nothing.

        Tells of the search for its `first` squeeze, then of its growth.
        """
        self.begun_s = self.limit.spent_s
        if self.hasty:
            grow_hastily(root, self.growth, seed, progress, lambda: self.late(root))
        else:
            squeeze_first(root, self.growth, seed, first, self.limit.over)
        least = 0.0 if self.hasty else self.growth.objective.params.improved_share
        grow(root, self.growth, seed, progress, lambda: self.late(root), least=least)
        self.growth_s = (self.limit.spent_s - self.begun_s) / max(self._done(root), LEAST_DONE)

    def late(self, root: TreeNode, kept_s: float = 0.0) -> bool:
        """Whether to leave a tree as it is, with so many seconds left; never without a first squeeze."""
        self.limit.standing = self.limit.standing or bool(root.children)
        late = bool(root.children) and self.limit.over(kept_s)
        self.cut = self.cut or late
        return late

    def told(self, root: TreeNode) -> tuple[int, int, str]:
        """Progress of a tree's growth for a `Report`: done, of how much, and what it comes to so far."""
        leaves = [node for node in breadth_first(root) if not node.children]
        waiting = sum(leaf.share for leaf in self._open(root))
        known = sum(leaf.share for leaf in leaves if leaf.mode.ratio >= self.growth.objective.confidence)
        return round(1000 * self._done(root)), 1000, f"{waiting:.1%} of the parts open, {known:.1%} located"

    def report(self) -> Cut | None:
        """How the search was cut short, if it was; the share that is open is not known before the trials."""
        if not self.cut:
            return None
        left_s = self.growth_s * (1.0 + AFTER_GROWTH) - (self.limit.spent_s - self.begun_s)
        return Cut(self.limit.asked, 1.0, max(left_s, self.limit.reserve_s, 1.0))

    def _done(self, root: TreeNode) -> float:
        """How much of the growth is done, 0 to 1: the mass that is not located falls about exponentially."""
        unlocated = sum(leaf.unlocated_mass for leaf in self._open(root))
        least = 1.0 - self.growth.objective.confidence
        if unlocated <= least:
            return 1.0
        return math.log(min(unlocated, 1.0)) / math.log(least) if least > 0.0 else 0.0

    def _open(self, root: TreeNode) -> list[TreeNode]:
        confidence = self.growth.objective.confidence
        leaves = (node for node in breadth_first(root) if not node.children)
        return [leaf for leaf in leaves if self.growth.worth_growing(leaf, confidence)]
