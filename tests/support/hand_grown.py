"""Plans of known structure, built without a search."""

import numpy as np

from planner.belief.metric import Mode
from planner.belief.observation import Partition
from planner.belief.particles import Belief
from planner.search.tree import Action, Node, Squeeze

PLACES = np.array([[-12.0, 0.0, 0.0], [0.0, 0.0, 0.0], [12.0, 0.0, 0.0]])


def leaf(poses, counts, share, depth):
    """Returns a node without actions; `share` is the share of all parts that reach it.

    Its particles lie at `poses` (n, 3); their last readings are `counts` (n,).
    """
    return Node(Belief.of(poses, counts), share, Mode(poses[0], 1.0), depth)


def squeezed(node, angle, groups):
    """Gives a node one squeeze at an angle [rad], and returns the node.

    The squeeze has a child for each (poses, counts) of `groups`, in order of width.
    """
    total = sum(len(poses) for poses, _ in groups)
    children = [
        leaf(poses, counts, node.share * len(poses) / total, node.depth + 1)
        for poses, counts in groups
    ]
    seen = Partition.of([counts for _, counts in groups])
    squeeze = Squeeze(np.array([0.0, 0.0, angle]), 85.0, 5.0, seen)
    node.actions = [Action(squeeze, children)]
    return node


def grown(silent=0):
    """Returns the root of a plan that distinguishes three places of a part by two squeezes.

    Before these two come `silent` squeezes, each of which reads one width at all places.
    """
    node = root = leaf(np.repeat(PLACES, 100, axis=0), np.full(300, -1), 1.0, 0)
    for _ in range(silent):
        squeezed(node, 0.3, [(node.belief.poses, np.full(300, 100))])
        (node,) = node.children
    one, two, three = np.split(node.belief.poses, 3)
    rest = np.concatenate([two, three])
    squeezed(node, 0.0, [(one, np.full(100, 200)), (rest, np.full(200, 100))])
    squeezed(node.children[1], 1.0, [(two, np.full(100, 180)), (three, np.full(100, 120))])
    return root
