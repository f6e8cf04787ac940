"""A lower bound on the mean squeezes of any plan of a class, by Lagrangian relaxation, and its confidence.

A plan claims parts where it ends a history with a predicted pose. A class of plans (`leaves_term`,
`overall_term`) has a constraint on the parts that a plan claims and does not locate. The relaxation drops the
constraint, and charges a price in squeezes for each such part: the multiplier of the constraint. Without the
constraint the cheapest plan on a sample of parts is found history by history. Its cost is a lower bound for
every plan of the class on this sample.

The best plan of the class does not depend on the sample. But on the sample this plan may take more squeezes
and miss more parts than on average. How many more, is bounded by Chernoff's inequality for the mean of n
independent numbers in [0, 1] of expectation mu (Hoeffding 1963, Theorem 1):

    P(mean - mu >= x) <= exp(-n KL(mu + x || mu)).

The price may be chosen after the sample is drawn.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import rel_entr

from planner.arrays import Array, IntArray
from planner.bound.histories import Level

PRICES = np.geomspace(1.0, 2000.0, 100)  # price of a claimed part that is not located [squeezes]
BISECTIONS = 60
EVENTS = 4  # inequalities that must hold at once: for each class one of its constraint and one of its mean


class Term(NamedTuple):
    """A lower bound on the mean squeezes of one class of plans."""

    squeezes: float  # least squeezes on average of any plan of the class
    estimate: float  # the bound without the allowance for the chance of the sample
    price: float  # price of a claimed part that is not located [squeezes]


def leaves_term(levels: list[Level], confidence: float, success: float, certainty: float) -> Term:
    """The bound for plans in which each leaf that claims a pose locates a share `confidence` of its parts.

    At least a share `success` of all parts must end in such leaves. With probability `certainty` this bound
    and the bound of `overall_term` both hold.
    """
    error, n = (1.0 - certainty) / EVENTS, int(levels[0].size.sum())
    excess = upper_tail(1.0 - confidence, n, error) - (1.0 - confidence)
    costs = np.array([least_cost(levels, price, confidence) for price in PRICES])
    unclaimed = (len(levels) - 1) * (1.0 - success)
    return _best(costs, costs - PRICES * excess, levels, error, unclaimed)


def overall_term(levels: list[Level], success: float, certainty: float) -> Term:
    """The bound for plans that locate at least a share `success` of all parts; see `leaves_term`."""
    error = (1.0 - certainty) / EVENTS
    costs = np.array([least_cost(levels, price, 1.0) for price in PRICES])
    failing = upper_tail(1.0 - success, int(levels[0].size.sum()), error)
    return _best(costs - PRICES * (1.0 - success), costs - PRICES * failing, levels, error, 0.0)


def least_cost(levels: list[Level], price: float, confidence: float) -> float:
    """Least mean cost of any plan on the sample [squeezes a part].

    Each squeeze costs 1. Where a plan claims n parts (states a pose for them), and m of them are located,
    this costs price * (confidence n - m). `levels` holds histories of up to some number of squeezes. After a
    history that was not extended, the bound assumes the best: one more squeeze for each part, then claims at
    no cost.
    """
    _, onward, _ = _values(levels, price, confidence)[0]
    return float(onward[0] / levels[0].size[0])  # every plan begins with a squeeze


def worth_trying(levels: list[Level], level: int, price: float, confidence: float) -> IntArray:
    """Finds the histories of a level that the cheapest plan reaches, and after which it squeezes again.

    Returns the numbers that these histories have in the level, without histories that are already extended.
    """
    values = _values(levels, price, confidence)
    reached = np.zeros(1, np.int64)
    for depth in range(level):
        cost, onward, option = values[depth]
        going = reached if depth == 0 else reached[onward[reached] <= cost[reached]]
        chosen = np.zeros(len(levels[depth + 1].owner), np.bool_)
        chosen[option[going][option[going] >= 0]] = True
        reached = np.flatnonzero(chosen[levels[depth + 1].option])
    cost, onward, option = values[level]
    return reached[(onward[reached] <= cost[reached]) & (option[reached] < 0)]


def _values(
    levels: list[Level], price: float, confidence: float
) -> list[tuple[Array, Array, IntArray]]:
    """Computes the least costs after all histories, level by level.

    A cost is the sum over all parts that have the history.

    Returns:
        For each level with h histories: the least cost (h,) after each history, the least cost (h,) if one
        more squeeze follows, and the best next squeeze (h,). This squeeze is an index into the squeezes of
        the next level; it is -1 for a history that was not extended.
    """
    results = list[tuple[Array, Array, IntArray]]()
    for level, longer in zip(levels[::-1], [None, *levels[:0:-1]], strict=True):
        onward, option = level.size.astype(np.float64), np.full(len(level.size), -1)
        if longer is not None:
            of_option = np.bincount(longer.option, results[0][0], minlength=len(longer.owner))
            order = np.lexsort((of_option, longer.owner))
            owner, first = np.unique(longer.owner[order], return_index=True)
            option[owner] = order[first]
            onward[owner] += of_option[option[owner]]
        claim = price * (confidence * level.size - level.located)
        results.insert(0, (np.minimum(onward, claim), onward, option))
    return results


def _best(
    estimates: Array, sampled: Array, levels: list[Level], error: float, unclaimed: float
) -> Term:
    """Returns the bound at the price at which it is greatest.

    Args:
        estimates: least cost on the sample at each price.
        sampled: least cost at each price, less an allowance: by chance, a plan may miss more parts on the
            sample than on average. Costs lie between 1 and depth + 1.
        levels: the histories.
        error: probability with which the bound on the mean cost may fail.
        unclaimed: allowance to subtract, since a plan need not claim every part [squeezes a part].
    """
    k, depth, n = int(np.argmax(sampled)), len(levels) - 1, int(levels[0].size.sum())
    share = min(max((float(sampled[k]) - 1.0) / depth, 0.0), 1.0)
    bound = 1.0 + depth * least_mean(share, n, error) - unclaimed
    return Term(max(bound, 1.0), max(float(estimates.max()) - unclaimed, 1.0), float(PRICES[k]))


def divergence(x: float, mean: float) -> float:
    """Kullback-Leibler divergence of a coin with probability x from a coin with probability `mean`."""
    return float(rel_entr(x, mean) + rel_entr(1.0 - x, 1.0 - mean))


def upper_tail(mean: float, n: int, error: float) -> float:
    """Value that the mean of n independent numbers in [0, 1] exceeds with probability `error` at most.

    Each number has the expectation `mean`.
    """
    return _crossing(lambda x: n * divergence(x, mean), mean, 1.0, error)


def least_mean(sample: float, n: int, error: float) -> float:
    """Least expectation of n independent numbers in [0, 1] that is compatible with their mean `sample`.

    With a smaller expectation, a mean of `sample` or more would have at most the probability `error`.
    """
    return _crossing(lambda x: n * divergence(sample, x), sample, 0.0, error)


def _crossing(exponent: Callable[[float], float], start: float, end: float, error: float) -> float:
    """Argument between `start` and `end` at which exp(-exponent) falls to `error`; `end` if it never does.

    exp(-exponent) is 1 at `start` and falls towards `end`.
    """
    near, far = start, end
    for _ in range(BISECTIONS):
        middle = 0.5 * (near + far)
        if exponent(middle) <= -math.log(error):
            near = middle
        else:
            far = middle
    return far
