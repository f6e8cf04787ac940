"""What may be done with a belief: the options of one squeeze, and the choice among them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.transition import Outcomes
from planner.frames import wrap

TAU = 0.02
"""What a belief may lack, about, before it counts as one that needs another squeeze."""
SELECTION_BIAS = 0.5
"""Standard deviations of the mode ratio that each cluster's mode gains by being chosen for it."""
ALIKE_MM, ALIKE_DEG = 8.0, 20.0
"""Placements nearer than this are varieties of one."""
WORTH_TRYING = 0.5
"""Squeezes that an alternative may seem to cost more."""


class Choice(NamedTuple):
    """An action for a belief.

    Attributes:
        placement: (3,) the hand frame in the world.
        cost_to_go: J of squeezing there.
        gain: in mode ratio, over stopping here, beyond selection bias.
    """

    placement: Array
    cost_to_go: float
    gain: float


class Options(NamedTuple):
    """One belief's options after one squeeze each.

    Attributes:
        placements: (k, 3) of the hand in the world.
        outcomes: k of them.
        cost: (k,) c.
        ratio: (k,) expected mode ratio after it.
        cost_to_go: (k,) J of depth 1.
        rank: (k,) the same with something for beliefs of two modes; less is better.
    """

    placements: Array
    outcomes: list[Outcomes]
    cost: Array
    ratio: Array
    cost_to_go: Array
    rank: Array

    def best(self, most: int) -> list[int]:
        """The most promising options."""
        return [int(k) for k in np.argsort(self.rank, kind="stable")[:most]]


def squeezes_left(ratio: Array) -> Array:
    """J(b, 0) of beliefs with these mode ratios: the squeezes that they still need, guessed."""
    outside = np.maximum(1.0 - ratio, 0.0)
    return np.asarray(1.0 - np.exp(-outside / TAU) + outside)


def selection_bias(ratio: float, particles: int, clusters: int) -> float:
    """What splitting a belief at random adds to its mode ratio: each cluster's mode is chosen to fit it."""
    return float(SELECTION_BIAS * np.sqrt(clusters * ratio * (1.0 - ratio) / particles))


def unlike(choices: list[Choice], most: int) -> list[Choice]:
    """The first of the choices, and those worth a trial that are not almost the same squeeze.

    Args:
        choices: the best first.
        most: how many to return at most.
    """
    found: list[Choice] = []
    for choice in choices:
        x, y, turn = np.abs([choice.placement - other.placement for other in found]).reshape(-1, 3).T
        turn = np.abs(wrap(turn, 2))
        near = (np.hypot(x, y) < ALIKE_MM) & (turn < np.radians(ALIKE_DEG))
        if not near.any() and choice.cost_to_go < choices[0].cost_to_go + WORTH_TRYING:
            found.append(choice)
    return found[:most]


def joined(a: Options, b: Options) -> Options:
    """The options of both."""
    return Options(
        np.concatenate([a.placements, b.placements]),
        a.outcomes + b.outcomes,
        np.concatenate([a.cost, b.cost]),
        np.concatenate([a.ratio, b.ratio]),
        np.concatenate([a.cost_to_go, b.cost_to_go]),
        np.concatenate([a.rank, b.rank]),
    )
