"""One more squeeze at leaves that answer strangers, where the goal says how many may be answered.

A pose that is known makes one width telling: own parts read few counts there, and others seldom the same.
"""

from collections.abc import Sequence

import numpy as np

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.belief.particles import Belief, subsample
from planner.belief.transition import MotionModel, Simulation, placing_of
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.mechanics.mixture import Mixture
from planner.search.actions import Action
from planner.search.expand import Growth, TreeNode, breadth_first, squeeze_at

PARTICLES = 200  # own particles of a leaf that each placement is tried with
HANDS = 96  # placements all about a leaf's modes that are tried
BESIDE = 2  # counts beside theirs that are accepted, too

Strays = list[tuple[Belief, MotionModel]]  # strangers that came to a leaf, of each kind, and how they move


def confirm(root: TreeNode, strange: Sequence[Evaluation], job: Job, growth: Growth, seed: list[int]) -> int:
    """Squeezes once more at leaves that answer strangers, until the other leaves answer few enough of each.

    The tree is modified in place. `strange` are trials of each stranger that the job names, of its table.
    Every leaf draws from a stream of its own, named after the seed and its path.

    Returns:
        How many leaves were squeezed again; there may be no placement clear of all parts.
    """
    models = [
        Simulation(Mixture.of_job(other), encoder_of(other), placing_of(other)) for other in job.strangers
    ]
    inner = breadth_first(root)
    parents = {id(child): node for node in inner for child in node.children}
    leaves = [node for node in inner if not node.children]
    chosen = _chosen(leaves, strange, job.goal.stranger_rate or 0.0, growth.max_depth)
    confirmed = 0
    for k in chosen:
        leaf, strays = leaves[k], Strays()
        for found, model in zip(strange, models, strict=True):
            here = (found.leaf == k) & found.resolved
            if here.any():
                last = found.counts[here, found.squeezes[here] - 1]
                strays.append((Belief(found.poses[here], found.traits[here], last), model))
        rng = np.random.default_rng([*seed, leaf.depth, *leaf.path])
        placement = _telling(leaf, strays, growth, rng)
        if placement is not None:
            squeeze_at(leaf, parents.get(id(leaf)), Action(placement), growth, rng)
            confirmed += 1
    return confirmed


def _chosen(leaves: list[TreeNode], strange: Sequence[Evaluation], rate: float, max_depth: int) -> list[int]:
    """Leaves that answer the most strangers for each own part, until those left answer few enough."""
    answered = np.array(
        [np.bincount(each.leaf[each.resolved], minlength=len(leaves)) / len(each.leaf) for each in strange]
    )
    answered[:, [leaf.depth >= max_depth for leaf in leaves]] = 0.0
    share, chosen = np.array([leaf.share for leaf in leaves]), []
    while (often := answered.sum(axis=1) > rate).any():
        chosen.append(int(np.argmax(answered[often].sum(axis=0) / np.maximum(share, 1e-6))))
        answered[:, chosen[-1]] = 0.0
    return chosen


def _telling(leaf: TreeNode, strays: Strays, growth: Growth, rng: np.random.Generator) -> Array | None:
    """The placement (3,) at which the fewest strays read like own parts; None where no hand is clear."""
    own = subsample(leaf.belief, PARTICLES)
    options = growth.look_ahead.ranking.scattered(own, own, HANDS)
    if not len(options):
        return None
    taken = np.zeros(len(options))
    for k, squeezed in enumerate(growth.reference.squeeze([(own, option) for option in options], rng)):
        near = np.unique(squeezed.belief.reading[:, None] + np.arange(-BESIDE, BESIDE + 1))
        for belief, model in strays:
            (stray,) = model.squeeze([(belief, options[k])], rng)
            taken[k] += np.isin(stray.belief.reading, near).sum()
    return np.asarray(options[np.argmin(taken)])
