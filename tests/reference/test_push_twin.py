"""The push kernels against a twin with another formulation, another integrator and another contact search."""

import math

import numpy as np
import pytest
from problems import hexagon, random_convex, rectangle, simulator
from push_paths import random_paths
from push_twin import push
from twin import Part

CLOSE_MM, CLOSE_RAD = 0.1, math.radians(0.2)


@pytest.mark.parametrize(
    ("outline", "mu"),
    [(rectangle(), 0.4), (hexagon(), 0.0), (random_convex(np.random.default_rng(3), 5), 0.4)],
)
def test_push_ends_like_twin(outline, mu):
    pushes = random_paths(outline, np.random.default_rng(8), 2)
    part = simulator(outline, step_mm=0.1)
    result = part.push(pushes, part.nominal(len(pushes.angles), mu))
    assert not result.given_up.any()
    for k, moved in enumerate(result.moved):
        twin = push(
            Part(outline, part.surface.A, part.surface.rho_mm, mu, None),
            *(values[k] for values in pushes),
        )
        assert math.hypot(*(moved - twin)[:2]) < CLOSE_MM
        assert abs(moved[2] - twin[2]) < CLOSE_RAD
