"""A step laid open: what the solver returns fulfils the paper's eqs 3-5, contact by contact."""

import numpy as np
import pytest
from contact_solutions import contact_solution
from problems import JAWS, place, rectangle

from planner.mechanics import quartic
from planner.mechanics.clearance import clearance
from planner.mechanics.lcp import RAY, SOLVED

pytestmark = pytest.mark.slow

A = np.diag([1.05, 1.06, 0.58])
RHO = 10.57


def touching(pose):
    points = place(rectangle(), pose)
    columns = np.ascontiguousarray(points.T)
    return points, tuple(f * (100.0 - clearance(columns, f, f * 100.0, 13.75)) for f in (1, -1))


@pytest.mark.parametrize(
    "surface", [A, quartic.of_ellipsoid(A, RHO).hessian_table()], ids=["ellipsoid", "quartic"]
)
def test_solutions_fulfil_complementarity_and_coulombs_law(surface):
    rng = np.random.default_rng(3)
    solved = pressed = 0
    for _ in range(300):
        pose = np.array([rng.uniform(-8, 8), 0.0, rng.uniform(-np.pi, np.pi)])
        points, faces = touching(pose)
        mu = tuple(rng.uniform(0.1, 0.7, 2))
        solution = contact_solution(points, pose, faces, JAWS, surface, RHO, mu, 0.1)
        if solution.status != SOLVED:
            assert solution.status == RAY
            continue
        solved += 1
        pressed += int((solution.force[:, 0] > 0.0).sum() > 1)
        assert max(solution.residuals()) < 1e-6
    assert solved > 100
    assert pressed > 20
