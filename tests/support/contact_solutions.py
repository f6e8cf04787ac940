"""One step's solution laid open: contacts, forces, motion, and how well they fulfil eqs 3-5."""

from typing import NamedTuple

import numpy as np
from contact_problems import ContactProblem, rows

from planner.arrays import Array
from planner.mechanics import contacts
from planner.mechanics.boundary import Drive, directions
from planner.mechanics.contacts import FINGER, FN, FT, GAP, N2, NX, NY, T2, UN, UT, Finger
from planner.mechanics.lcp import SOLVED
from planner.mechanics.step import STEP_WORK, TOUCHING_MM, StepWork
from planner.mechanics.surface_step import solve_surface


def workspace() -> StepWork:
    """A fresh workspace of a step."""
    return np.zeros(1, STEP_WORK).view(np.recarray)[0]


def posed(problem: ContactProblem) -> StepWork:
    """A workspace with the contacts of a problem."""
    work = workspace()
    work.A[:] = problem.A
    work.C[:], work.I[:] = rows(problem)
    return work


class Residuals(NamedTuple):
    """Largest violations; all 0 for an exact solution.

    Attributes:
        overlap_mm: of gap + N . V - u_n >= 0 (eq. 3).
        normal_mm: of f_n complementary to that gap: the smaller of the two.
        cone: of |f_t| <= mu f_n (eq. 5), in units of force.
        stick_mm: of sticking inside the cone (eqs 4, 5): the smaller of slip and mu f_n - |f_t|.
        along: of friction opposing slip (eq. 4): the power it would gain.
    """

    overlap_mm: float
    normal_mm: float
    cone: float
    stick_mm: float
    along: float


class ContactSolution(NamedTuple):
    """The solution of one step.

    Attributes:
        status: `lcp.SOLVED`, `lcp.RAY` (held) or `lcp.PIVOT_LIMIT`.
        V: (3,) displacement dx, dy, rho dtheta [mm].
        force: (k, 2) normal and tangential force of each touching contact.
        slack_mm: (k,) gap after the step.
        slip_mm: (k,) slip along the tangent.
        mu: (k,) friction of each.
    """

    status: int
    V: Array
    force: Array
    slack_mm: Array
    slip_mm: Array
    mu: Array

    def residuals(self) -> Residuals:
        """How well the solution fulfils eqs 3-5."""
        fn, ft = self.force[:, 0], self.force[:, 1]
        room = self.mu * fn - np.abs(ft)
        smaller = np.minimum(np.abs(self.slack_mm), fn)
        still = np.minimum(np.abs(self.slip_mm), np.maximum(room, 0.0))
        return Residuals(
            overlap_mm=_largest(-self.slack_mm),
            normal_mm=_largest(smaller),
            cone=_largest(-room),
            stick_mm=_largest(still),
            along=_largest(ft * self.slip_mm),
        )


def contact_solution(
    points: Array,
    pose: Array,
    faces: tuple[float, float],
    jaws: Array,
    surface: Array,
    rho_mm: float,
    mu: tuple[float, float],
    advance_mm: float,
) -> ContactSolution:
    """Solves one step of both fingers and keeps everything.

    Args:
        points: (N, 2) the outline in the hand frame, counter-clockwise [mm].
        pose: (3,) the part's pose in the hand frame [mm, mm, rad].
        faces: y of the upper and the lower inner face [mm].
        jaws: (4,) as in `squeeze`.
        surface: (3, 3) ellipsoid or (6, 6) quartic, in the part's frame.
        rho_mm: length that normalises rotations.
        mu: friction at the upper and the lower finger.
        advance_mm: how far each finger closes.
    """
    work = workspace()
    C, I, V = work.C, work.I, work.V
    columns, out = np.ascontiguousarray(points.T), np.zeros(len(points), np.int64)
    half, thick = 0.5 * jaws[1], jaws[2]
    sides = zip((1, -1), faces, strict=True)
    upper, lower = (Finger(side, 0.0, y, half, thick) for side, y in sides)
    count = contacts.find(C, I, columns, out, pose, contacts.Hand(upper, lower, 2), TOUCHING_MM)
    directions(C, I, count, rho_mm, Drive(advance_mm, advance_mm, 0.0, 0.0, 0.0))
    work.F[:] = 0.0, 1.0, 0.0
    status = solve_surface(surface, np.cos(pose[2]), np.sin(pose[2]), mu[0], mu[1], count, work)
    C, I = C[:count], I[:count]
    slack = C[:, GAP] - C[:, UN] + C[:, NX] * V[0] + C[:, NY] * V[1] + C[:, N2] * V[2]
    slip = C[:, NX] * V[1] - C[:, NY] * V[0] + C[:, T2] * V[2] - C[:, UT]
    friction = np.where(I[:, FINGER] == 1, mu[0], mu[1])
    force = C[:, [FN, FT]] if status == SOLVED else np.zeros((count, 2))
    return ContactSolution(int(status), V, force, slack, slip, friction)


def _largest(values: Array) -> float:
    return float(max(values.max(initial=0.0), 0.0))
