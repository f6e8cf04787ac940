"""Which of the hands all about a part tell most, where few do: they are tried before the others.

Squeezes along a part's sides leave it at two poses, one the other turned by what the part looks nearly the
same after. Which hands tell these apart depends on the part alone, so it is found once.
"""

import math
from dataclasses import replace

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.doubts import traits_of
from planner.belief.observation import COUNTS
from planner.belief.particles import Belief
from planner.belief.transition import MotionModel
from planner.job.model import Job
from planner.part.symmetry import nearest_turn
from planner.search.actions import ActionSet
from planner.search.proposals import Proposals

PARTS = 12  # squeezed by each hand at each of the two poses
SPREAD = (0.3, 0.3, math.radians(2.0))  # standard deviations of parts about these [mm, mm, rad]
SMOOTHED = (0.25, 0.5, 0.25)  # share of a reading one count below it, at it and one above
MANY = 0.05  # share of all hands that is enough to find one of them as they lie
TELLS = 0.25  # overlap of its readings below which a hand tells the two poses apart


def foremost(actions: ActionSet, job: Job, model: MotionModel, rng: np.random.Generator) -> ActionSet:
    """The actions, the scattered hands of each part of which few tell in the order of `order`.

    Args:
        actions: what to choose from.
        job: whose parts they are.
        model: squeezes and reads them.
        rng: source of randomness.
    """
    own = [_foremost(each, job, k, model, rng) for k, each in enumerate(actions.proposals)]
    return replace(actions, proposals=tuple(own))


def overlap(reading: IntArray) -> Array:
    """The share of the readings (k, 2 n) of k hands, n at either pose, that both poses have: (k,)."""
    k, n = len(reading), reading.shape[1] // 2
    at = np.repeat(np.arange(2 * k), n) * COUNTS + reading.reshape(-1)
    share = np.bincount(at, minlength=2 * k * COUNTS).reshape(2 * k, COUNTS) / n
    below, here, above = SMOOTHED
    share = below * np.roll(share, -1, axis=1) + here * share + above * np.roll(share, 1, axis=1)
    return np.asarray(np.minimum(share[0::2], share[1::2]).sum(axis=1))


def order(overlap: Array) -> IntArray:
    """Hands by their overlap (k,): in turns the one left that tells most, and the next as they lie."""
    rank = np.argsort(np.argsort(overlap, kind="stable"), kind="stable")
    return np.argsort(np.minimum(2 * rank, 2 * np.arange(len(rank)) + 1), kind="stable")


def _foremost(own: Proposals, job: Job, k: int, model: MotionModel, rng: np.random.Generator) -> Proposals:
    """The proposals for the k-th of a job's parts."""
    part = job.alone[k].part
    poses = rng.standard_normal((2 * PARTS, 3)) * SPREAD
    poses[PARTS:, 2] += math.radians(nearest_turn(part.outline_mm, part.symmetry).degrees)
    traits = traits_of(job.alone[k], len(poses), rng)
    traits["hypothesis"] = k
    belief = Belief.of(poses, traits=traits)
    squeezed = model.squeeze([(belief, hand) for hand in own.scattered], rng)
    found = overlap(np.array([each.belief.reading for each in squeezed]))
    few = np.quantile(found, MANY) > TELLS
    return replace(own, scattered=own.scattered[order(found)]) if few else own
