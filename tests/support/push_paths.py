"""Paths of pushers, shared by tests."""

import math

import numpy as np

from planner.mechanics.push import Paths


def paths(points, centre=(0.0, 0.0), angle=0.0, shift=(0.0, 0.0)):
    """Returns `Paths` with one path, along which a pusher with points (K, 2) moves.

    The pusher turns by `angle` [rad] about `centre`, while the centre moves by `shift`.
    """
    return Paths(*(np.array([each], float) for each in (points, centre, angle, shift)))


def joined(many):
    return Paths(*(np.concatenate(arrays) for arrays in zip(*many, strict=True)))


def random_paths(outline, rng, count):
    """Draws `count` paths of a pusher with two points.

    The points start at a random edge of the outline, and turn about a random centre or move straight.
    """
    result = []
    while len(result) < count:
        k = rng.integers(len(outline))
        start, end = outline[k], outline[(k + 1) % len(outline)]
        edge = (end - start) / math.hypot(*(end - start))
        middle, half = start + rng.uniform(0.3, 0.7) * (end - start), rng.uniform(1.0, 4.0)
        inward = np.array([-edge[1], edge[0]])
        way = inward * rng.uniform(4.0, 12.0) + edge * rng.uniform(-4.0, 4.0)
        fingers = [middle - half * edge - 1e-6 * inward, middle + half * edge - 1e-6 * inward]
        if rng.random() < 0.3:
            result.append(paths(fingers, shift=way))
            continue
        arm = rng.uniform(15.0, 60.0) * rng.choice([-1.0, 1.0])
        result.append(paths(fingers, middle + arm * edge, math.copysign(0.2, -arm)))
    return joined(result)
