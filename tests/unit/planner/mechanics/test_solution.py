"""One step of the solver: its result fulfils the paper's eqs 3-5 at each contact."""

import numpy as np
import pytest
from contact_problems import workspace
from problems import JAWS, place, rectangle

from planner.mechanics import contacts, quartic
from planner.mechanics.boundary import Drive, directions
from planner.mechanics.clearance import clearance
from planner.mechanics.lcp import RAY, SOLVED
from planner.mechanics.step import TOUCHING_MM
from planner.mechanics.surface_step import solve_surface

pytestmark = pytest.mark.slow

A = np.diag([1.05, 1.06, 0.58])
RHO = 10.57


def stepped(pose, surface, friction):
    """Solves one step from the first touch of the closing fingers.

    Returns:
        Status, touching contacts, their friction, and the displacement of the part (3,).
    """
    columns = np.ascontiguousarray(place(rectangle(), pose).T)
    half, thickness = 0.5 * JAWS.length_mm, JAWS.thickness_mm
    faces = (side * (100.0 - clearance(columns, side, side * 100.0, half)) for side in (1, -1))
    fingers = (
        contacts.Finger(side, 0.0, face, half, thickness)
        for side, face in zip((1, -1), faces, strict=True)
    )
    work, out = workspace(), np.zeros(columns.shape[1], np.int64)
    hand = contacts.Hand(*fingers, 2)
    count = contacts.find(work.contacts, columns, out, pose, hand, TOUCHING_MM)
    directions(work.contacts, count, RHO, Drive(0.1, 0.1, 0.0, 0.0, 0.0))
    work.F[:] = 0.0, 1.0, 0.0
    status = solve_surface(surface, np.cos(pose[2]), np.sin(pose[2]), *friction, count, work)
    met = work.contacts[:count]
    return status, met, np.where(met["finger"] == 1, *friction), work.V


def violations(met, mu, V):
    """For each condition of eqs 3 to 5, by how much each contact violates it; at most 0 if it is met."""
    nx, ny, fn, ft = met["nx"], met["ny"], met["fn"], met["ft"]
    slack = met["gap"] - met["un"] + nx * V[0] + ny * V[1] + met["n2"] * V[2]
    slip = nx * V[1] - ny * V[0] + met["t2"] * V[2] - met["ut"]
    room = mu * fn - np.abs(ft)
    return {
        "overlap": -slack,
        "force across a gap": np.minimum(np.abs(slack), fn),
        "friction beyond the cone": -room,
        "slip within the cone": np.minimum(np.abs(slip), np.maximum(room, 0.0)),
        "friction along the slip": ft * slip,
    }


@pytest.mark.parametrize(
    "surface", [A, quartic.of_ellipsoid(A, RHO).hessian_table()], ids=["ellipsoid", "quartic"]
)
def test_solve_surface_fulfils_complementarity_and_coulombs_law(surface):
    rng = np.random.default_rng(3)
    solved = pressed = 0
    for _ in range(300):
        pose = np.array([rng.uniform(-8, 8), 0.0, rng.uniform(-np.pi, np.pi)])
        status, met, mu, V = stepped(pose, surface, rng.uniform(0.1, 0.7, 2))
        if status != SOLVED:
            assert status == RAY
            continue
        solved += 1
        pressed += int((met["fn"] > 0.0).sum() > 1)
        for name, values in violations(met, mu, V).items():
            assert values.max(initial=0.0) < 1e-6, name
    assert solved > 100
    assert pressed > 20
