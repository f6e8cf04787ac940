"""The rule by which a belief counts as located, for the search, its trials and the table."""

from __future__ import annotations

import math
from typing import NamedTuple

from planner.kernel import inner_kernel
from runtime import table as tables

FAILURE = 100.0
"""Cost of a part that is not located, in typical squeezes: a squeeze is worth 1 % of success."""
LEAST_EVIDENCE = 300
"""Particles below which a belief is too small for its mode ratio to be trusted."""
LEAST_TRIALS = 100
"""Number of fresh trials of a leaf from which their success rate itself is compared with the goal.

The exact test alone keeps leaves just below the goal, which later trials refute.
"""


class StoppingRule(NamedTuple):
    """Decides whether a leaf locates its part, by `hits` of `size` particles within the goal of its pose.

    Given the sample, the true share of hits has a Beta distribution; `inside` and `outside` are its prior
    counts, since small samples look too pure.

    Attributes:
        confidence: share of hits at which a belief needs no further squeeze.
        failure: cost of a part that is not at the pose of its leaf [squeezes].
        inside: prior particles within the goal.
        outside: prior particles outside it.
    """

    confidence: float
    failure: float = FAILURE
    inside: float = 10.0
    outside: float = 0.5

    def reached(self, ratio: float) -> bool:
        """Whether the search makes a leaf of a belief with this mode ratio."""
        return ratio >= self.confidence

    def refuted(self, hits: int, trials: int) -> bool:
        """Whether fresh trials refute that a leaf reaches the confidence.

        They do if a significance test says so. They also do if there are at least `LEAST_TRIALS` trials, and
        the share of hits among them is below the confidence.
        """
        fails = trials >= LEAST_TRIALS and hits < self.confidence * trials
        return fails or tables.refuted(hits, trials, self.confidence)

    def holds(self, ratio: float, size: int) -> bool:
        """Whether a table may call a leaf resolved, by its mode ratio in a sample of `size` particles.

        It may if the ratio reaches the confidence. It also may if the sample has at least `LEAST_EVIDENCE`
        particles and is compatible with a true share as large as the confidence.
        """
        enough, hits = size >= LEAST_EVIDENCE, round(ratio * size)
        return self.reached(ratio) or (enough and not tables.refuted(hits, size, self.confidence))

    def cost_to_go(self, hits: float, size: float) -> float:
        """Leaf heuristic of a belief with `hits` of `size` particles in its modes; see `squeezes_left`."""
        return squeezes_left(float(hits), float(size), self)


@inner_kernel
def missed(hits: float, size: float, rule: StoppingRule) -> tuple[float, float]:
    """Probability that a belief misses the goal, and the expected share of parts outside its modes."""
    total = size + rule.inside + rule.outside
    share = (hits + rule.inside) / total
    deviation = math.sqrt(share * (1.0 - share) / total)
    return 0.5 * math.erfc((share - rule.confidence) / (deviation * math.sqrt(2.0))), 1.0 - share


@inner_kernel
def squeezes_left(hits: float, size: float, rule: StoppingRule) -> float:
    """Leaf heuristic: the cost-to-go of a belief with `hits` of `size` particles in its modes [squeezes].

    A belief that misses the goal needs one more squeeze, and a second one with a probability equal to the
    share of its particles outside the modes. A belief that meets the goal costs `failure` times the expected
    share of its parts outside the modes, but no more than a belief that misses the goal. The result is the
    mean of the two costs, weighted by the probability that the belief misses the goal.
    """
    open_still, rest = missed(hits, size, rule)
    further = 2.0 - hits / size
    return open_still * further + (1.0 - open_still) * min(rule.failure * rest, further)
