"""When a belief counts as located: one rule for the search, its trials and the table."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inner_kernel
from runtime import table as tables

FAILURE = 100.0
"""Cost of a part that is not located, in typical squeezes: one more has to gain 1 % in success."""
LEAST_EVIDENCE = 300
"""Particles from which a mode ratio below the goal may be chance; with fewer, too much is left open."""
LEAST_TRIALS = 100
"""Fresh trials of a leaf from which their success rate itself is compared with the goal: by the exact test
alone leaves just below the goal stay, and later trials refute them."""


class StoppingRule(NamedTuple):
    """What "located" means of `hits` parts in `size` that lie within the goal of a leaf's pose.

    The share of hits in truth has a Beta distribution, given the sample; `inside` and `outside` are the
    particles assumed to have been seen before it, since small samples look too pure.

    Attributes:
        confidence: share of hits at which a belief needs no further squeeze.
        failure: cost of a part that is not where its leaf says [squeezes].
        inside: prior particles within the goal.
        outside: prior particles outside it.
    """

    confidence: float
    failure: float = FAILURE
    inside: float = 10.0
    outside: float = 0.5

    def reached(self, ratio: float) -> bool:
        """Whether the search makes a leaf of a belief with such a mode ratio."""
        return ratio >= self.confidence

    def refuted(self, hits: int, trials: int) -> bool:
        """Whether fresh trials of a leaf speak against it, or are likely to once the plan is finished."""
        fails = trials >= LEAST_TRIALS and hits < self.confidence * trials
        return fails or tables.refuted(hits, trials, self.confidence)

    def holds(self, ratio: float, size: int) -> bool:
        """Whether a table may call a leaf resolved: a miss is no larger than fresh trials of a good leaf."""
        if self.reached(ratio):
            return True
        return size >= LEAST_EVIDENCE and not tables.refuted(
            round(ratio * size), size, self.confidence
        )

    def cost_to_go(self, hits: Array, size: IntArray) -> Array:
        """Squeezes left (n,) of beliefs with `hits` (n,) of `size` (n,) particles in their modes."""
        return np.array(
            [squeezes_left(float(k), float(n), *self) for k, n in zip(hits, size, strict=True)]
        )


@inner_kernel
def missed(
    hits: float, size: float, confidence: float, inside: float, outside: float
) -> tuple[float, float]:
    """Probability that a belief misses the goal, and the expected share outside its modes."""
    total = size + inside + outside
    share = (hits + inside) / total
    deviation = math.sqrt(share * (1.0 - share) / total)
    return 0.5 * math.erfc((share - confidence) / (deviation * math.sqrt(2.0))), 1.0 - share


@inner_kernel
def squeezes_left(
    hits: float, size: float, confidence: float, failure: float, inside: float, outside: float
) -> float:
    """Leaf heuristic: squeezes left of a belief with `hits` of `size` particles in its modes.

    A belief that misses the goal needs one squeeze more, and a second one the more likely the more is
    missing. One that meets it costs what its parts outside the modes are worth.
    """
    open_still, rest = missed(hits, size, confidence, inside, outside)
    further = 2.0 - hits / size
    return open_still * further + (1.0 - open_still) * min(failure * rest, further)
