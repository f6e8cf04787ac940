"""What keeps a plan from being shorter: nodes that many parts still come to late, and what is open there."""

from typing import Any, NamedTuple

from planner.belief.metric import metric_of
from planner.diagnosis.ambiguity import Whereabouts, whereabouts
from planner.job.model import Job
from planner.part.outline import radius_of_gyration
from planner.search.expand import TreeNode, breadth_first

LATE = 3  # squeezes after which most parts should be located
LEAST_SHARE = 0.02
MOST_POSES = 2


class Delay(NamedTuple):
    """A node whose parts take one squeeze more."""

    node: int  # its index in the table
    made: int  # squeezes before it
    share: float  # of all parts that come to it
    where: Whereabouts  # the poses of these parts

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {"node": self.node, "made": self.made, "share": self.share, **self.where.figures()}

    def line(self) -> str:
        """For people."""
        poses, shares, scatter = self.where
        named = Whereabouts(poses[:MOST_POSES], shares[:MOST_POSES]).text(0)
        text = f"node {self.node}: after {self.made} squeezes {self.share:.1%} of the parts lie at {named}"
        return text + f", nearly all others within {scatter:.1f} times the goal" if scatter else text


def delays(root: TreeNode, job: Job, most: int) -> list[Delay]:
    """The nodes of a job's tree that most parts come to after `LATE` squeezes or more, at most so many."""
    metric = metric_of(job, radius_of_gyration(job.part.outline_mm))
    inner = [node for node in breadth_first(root) if node.children]
    late = [k for k, node in enumerate(inner) if node.depth >= LATE and node.share >= LEAST_SHARE]
    found = []
    for k in sorted(late, key=lambda k: -inner[k].share)[:most]:
        where = whereabouts(inner[k].belief.poses, metric)
        found.append(Delay(k, inner[k].depth, inner[k].share, where))
    return found
