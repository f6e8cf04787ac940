"""Contact problems for tests; the docstring of a problem says what is special about it.

`lcp` writes a `ContactProblem` as eqs 1-5 of the paper, `rows` as the records that the kernels read.
"""

import math
from typing import NamedTuple

import numpy as np

from planner.mechanics import contacts
from planner.mechanics.step import STEP_WORK, StepWork


class ContactProblem(NamedTuple):
    """The m contacts of fingers and part at one instant; lengths in mm, points relative to the part's origin.

    Attributes:
        A: (3, 3) limit surface matrix.
        rho: length by which torques and turns are normalised in `A`.
        points: (m, 2) points of contact.
        normals: (m, 2) unit normals into the part.
        advance: (m, 2) displacement of the finger at each contact during the step.
        gap: (m,) distance between finger and part at each contact; 0 if they touch.
        mu: (m,) coefficient of friction at each contact.
    """

    A: np.ndarray
    rho: float
    points: np.ndarray
    normals: np.ndarray
    advance: np.ndarray
    gap: np.ndarray
    mu: np.ndarray


def wrenches(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """Returns the wrenches (m, 3) of unit normal forces, and those of unit tangential forces (eq. 2).

    Torques are divided by `rho`.
    """
    tangents = np.column_stack([-problem.normals[:, 1], problem.normals[:, 0]])
    x, y = problem.points.T
    N, T = (
        np.column_stack([f, (x * f[:, 1] - y * f[:, 0]) / problem.rho])
        for f in (problem.normals, tangents)
    )
    return N, T


def goals(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """Returns two displacements (m,) that the contacts require of the part [mm].

    The first is along each normal: the least displacement that keeps the part out of the finger. The second
    is along each tangent: the finger's displacement, which the part shares where the contact sticks.
    """
    n, u = problem.normals, problem.advance
    return (n * u).sum(axis=1) - problem.gap, -n[:, 1] * u[:, 0] + n[:, 0] * u[:, 1]


def lcp(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """Returns M (4 m, 4 m) and q (4 m,) of eqs 1-5 in the form w = M z + q.

    z consists of f_n, f_t+, f_t- and lambda, each (m,).
    """
    N, T = wrenches(problem)
    normal, tangential = goals(problem)
    m = len(normal)
    D = np.concatenate([N, T, -T])
    M = np.zeros((4 * m, 4 * m))
    M[: 3 * m, : 3 * m] = D @ problem.A @ D.T
    identity = np.eye(m)
    M[m : 3 * m, 3 * m :] = np.concatenate([identity, identity])
    M[3 * m :, : 3 * m] = np.concatenate([np.diag(problem.mu), -identity, -identity], axis=1)
    return M, np.concatenate([-normal, -tangential, tangential, np.zeros(m)])


def rows(problem: ContactProblem) -> np.ndarray:
    """Returns the contacts as the records of the kernels; even contacts belong to the upper finger."""
    N, T = wrenches(problem)
    result = np.zeros(contacts.MAX_CONTACTS, contacts.CONTACT)
    met = result[: len(N)]
    met["x"], met["y"] = problem.points.T
    met["nx"], met["ny"] = problem.normals.T
    met["gap"], met["n2"], met["t2"] = problem.gap, N[:, 2], T[:, 2]
    normal, tangential = goals(problem)
    met["un"], met["ut"] = normal + problem.gap, tangential
    met["finger"] = np.where(np.arange(len(N)) % 2 == 0, 1, -1)
    return result


def random_contacts(rng: np.random.Generator, m: int) -> ContactProblem:
    """Draws m contacts with x and y within 20 mm and normals in any direction.

    Two fingers close by up to 0.5 mm each. Even contacts belong to the upper finger, odd contacts to the
    lower. About a third of the contacts have a gap.
    """
    root = rng.normal(size=(3, 3))
    angle = rng.uniform(0, math.tau, m)
    advance = rng.uniform(0.05, 0.5, 2)
    closing = np.where(np.arange(m) % 2 == 0, -advance[0], advance[1])
    mu = np.where(np.arange(m) % 2 == 0, *rng.uniform(0.0, 1.0, 2))
    return ContactProblem(
        A=root @ root.T + 0.2 * np.eye(3),
        rho=10.0,
        points=rng.uniform(-20, 20, (m, 2)),
        normals=np.column_stack([np.cos(angle), np.sin(angle)]),
        advance=np.column_stack([np.zeros(m), closing]),
        gap=np.where(rng.random(m) < 0.33, rng.uniform(0, 0.2, m), 0.0),
        mu=mu,
    )


def _problem(points: list, normals: list, advance: list, mu: float) -> ContactProblem:
    m, arrays = len(points), (np.array(rows, float) for rows in (points, normals, advance))
    A = np.diag([1.05, 1.05, 0.58])
    return ContactProblem(A, 10.0, *arrays, np.zeros(m), np.full(m, mu))


UP, DOWN = [0.0, 1.0], [0.0, -1.0]


def sticking() -> ContactProblem:
    """A finger pushes a vertex almost towards the part's centre: the contact sticks."""
    return _problem([[1.0, -10.0]], [UP], [[0.0, 0.1]], mu=0.5)


def sliding() -> ContactProblem:
    """A finger moves at about 60 degrees to the normal: the contact slides, at the limit of friction."""
    return _problem([[1.0, -10.0]], [UP], [[0.2, 0.1]], mu=0.3)


def receding() -> ContactProblem:
    """The finger moves away from the part: there is no force, and the part does not move."""
    return _problem([[1.0, -10.0]], [UP], [[0.05, -0.1]], mu=0.5)


def jamming(offset_deg: float = 20.0, mu: float = 0.5) -> ContactProblem:
    """Two fingers press on opposite vertices, whose diagonal is `offset_deg` from the closing axis.

    If this angle is less than atan(mu), the part jams, and the problem has no solution.
    """
    angle = math.radians(offset_deg)
    tip = 18.0 * np.array([math.sin(angle), math.cos(angle)])
    return _problem([list(tip), list(-tip)], [DOWN, UP], [[0.0, -0.1], [0.0, 0.1]], mu)


def flush(rng: np.random.Generator) -> ContactProblem:
    """Draws a part with two sides, parallel or nearly so, between the fingers; each has two contacts."""
    ends, tilt = rng.uniform(-15.0, 15.0, (2, 2)), rng.choice([0.0, 1e-2])
    points = np.column_stack([ends.T.ravel(), np.tile([8.0, -8.0], 2)])
    down, up = [math.sin(tilt), -math.cos(tilt)], UP
    advance = np.tile([[0.0, -0.2], [0.0, 0.2]], (2, 1))
    return _problem(list(points), [down, up, down, up], list(advance), rng.uniform(0.0, 0.8))


def wedged() -> ContactProblem:
    """A finger's corner is wedged in a notch, and the other finger presses from below: no solution."""
    left, right = math.radians(-60.0), math.radians(-120.0)
    normals = [[math.cos(left), math.sin(left)], [math.cos(right), math.sin(right)], UP]
    points, advance = [[-0.1, 3.0], [0.1, 3.0], [0.0, -6.0]], [[0.0, -0.1], [0.0, -0.1], [0.0, 0.1]]
    return _problem(points, normals, advance, mu=0.4)


def flush_push() -> ContactProblem:
    """A finger's face pushes a face of the part at two contacts: the motion is unique, the forces are not."""
    return _problem([[-8.0, -10.0], [8.0, -10.0]], [UP, UP], [[0.0, 0.1], [0.0, 0.1]], mu=0.5)


def flush_grasp() -> ContactProblem:
    """Each finger presses on a face of the part at two contacts: no solution, whatever the friction."""
    points = [[-8.0, -10.0], [8.0, -10.0], [-8.0, 10.0], [8.0, 10.0]]
    return _problem(points, [UP, UP, DOWN, DOWN], [[0.0, 0.1]] * 2 + [[0.0, -0.1]] * 2, mu=0.5)


def repeated_contact() -> ContactProblem:
    """The same contact listed three times: the equations of any two of the three are linearly dependent."""
    return _problem([[6.0, -10.0]] * 3, [UP] * 3, [[0.0, 0.1]] * 3, mu=0.5)


HAVE_MOTION = {
    "sticking": sticking,
    "sliding": sliding,
    "receding": receding,
    "flush push": flush_push,
    "repeated contact": repeated_contact,
}
HAVE_NONE = {"jamming": jamming, "wedged": wedged, "flush grasp": flush_grasp}


def workspace() -> StepWork:
    """Returns an empty workspace for one step of the kernels."""
    return np.zeros(1, STEP_WORK).view(np.recarray)[0]


def posed(problem: ContactProblem) -> StepWork:
    """Returns a workspace that contains the limit surface and the contacts of a problem."""
    work = workspace()
    work.A[:] = problem.A
    work.contacts[:] = rows(problem)
    return work
