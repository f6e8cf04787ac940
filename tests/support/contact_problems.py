"""Instants of contact shared by tests, each with what is odd about it.

`lcp` poses a `ContactProblem` as eqs 1-5 of the paper, `rows` as the kernels' records.
"""

import math
from typing import NamedTuple

import numpy as np

from planner.mechanics import contacts
from planner.mechanics.step import STEP_WORK, StepWork


class ContactProblem(NamedTuple):
    """One instant of contact; positions and advances in mm, relative to the part's origin.

    Attributes:
        A: (3, 3) limit surface matrix.
        rho: the length it is normalised with.
        points: (m, 2) points of contact.
        normals: (m, 2) unit normals into the part.
        advance: (m, 2) displacement of the finger at each contact.
        gap: (m,) distance still open.
        mu: (m,) friction.
    """

    A: np.ndarray
    rho: float
    points: np.ndarray
    normals: np.ndarray
    advance: np.ndarray
    gap: np.ndarray
    mu: np.ndarray


def wrenches(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """Normalised wrenches (m, 3) of unit normal and tangential force at each contact (eq. 2)."""
    tangents = np.column_stack([-problem.normals[:, 1], problem.normals[:, 0]])
    x, y = problem.points.T
    N, T = (
        np.column_stack([f, (x * f[:, 1] - y * f[:, 0]) / problem.rho])
        for f in (problem.normals, tangents)
    )
    return N, T


def goals(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """What each contact asks of the part: least motion along the normal, the finger's along the tangent."""
    n, u = problem.normals, problem.advance
    return (n * u).sum(axis=1) - problem.gap, -n[:, 1] * u[:, 0] + n[:, 0] * u[:, 1]


def lcp(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """Eqs 1-5 as w = M z + q, with z = (f_n, f_t+, f_t-, lambda), each (m,)."""
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
    """The same contacts as the kernels' records; even ones belong to the upper finger."""
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
    """Contacts anywhere within 20 mm, normals in any direction, two fingers closing by up to 0.5 mm each.

    Even contacts belong to the upper finger and odd ones to the lower; a third of them have a gap still open.
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
    """One vertex pushed almost through the centre: friction is never spent."""
    return _problem([[1.0, -10.0]], [UP], [[0.0, 0.1]], mu=0.5)


def sliding() -> ContactProblem:
    """The pusher moves at 60 degrees to its normal: the force is on the edge of its cone."""
    return _problem([[1.0, -10.0]], [UP], [[0.2, 0.1]], mu=0.3)


def receding() -> ContactProblem:
    """The finger moves away: the answer is no force and no motion."""
    return _problem([[1.0, -10.0]], [UP], [[0.05, -0.1]], mu=0.5)


def jamming(offset_deg: float = 20.0, mu: float = 0.5) -> ContactProblem:
    """Two vertices on a diagonal `offset_deg` from the closing axis: no solution within atan(mu)."""
    angle = math.radians(offset_deg)
    tip = 18.0 * np.array([math.sin(angle), math.cos(angle)])
    return _problem([list(tip), list(-tip)], [DOWN, UP], [[0.0, -0.1], [0.0, 0.1]], mu)


def flush(rng: np.random.Generator) -> ContactProblem:
    """Two sides of a part, about parallel, between two faces that meet it at two points each."""
    ends, tilt = rng.uniform(-15.0, 15.0, (2, 2)), rng.choice([0.0, 1e-2])
    points = np.column_stack([ends.T.ravel(), np.tile([8.0, -8.0], 2)])
    down, up = [math.sin(tilt), -math.cos(tilt)], UP
    advance = np.tile([[0.0, -0.2], [0.0, 0.2]], (2, 1))
    return _problem(list(points), [down, up, down, up], list(advance), rng.uniform(0.0, 0.8))


def wedged() -> ContactProblem:
    """A finger's corner deep in a notch of 60 degrees, the other finger below: no way out."""
    left, right = math.radians(-60.0), math.radians(-120.0)
    normals = [[math.cos(left), math.sin(left)], [math.cos(right), math.sin(right)], UP]
    points, advance = [[-0.1, 3.0], [0.1, 3.0], [0.0, -6.0]], [[0.0, -0.1], [0.0, -0.1], [0.0, 0.1]]
    return _problem(points, normals, advance, mu=0.4)


def flush_push() -> ContactProblem:
    """A face pushed by a face: two contacts share one force, so that no force is unique, the motion is."""
    return _problem([[-8.0, -10.0], [8.0, -10.0]], [UP, UP], [[0.0, 0.1], [0.0, 0.1]], mu=0.5)


def flush_grasp() -> ContactProblem:
    """Two faces between two faces: four contacts, rank two, and no solution whatever the friction."""
    points = [[-8.0, -10.0], [8.0, -10.0], [-8.0, 10.0], [8.0, 10.0]]
    return _problem(points, [UP, UP, DOWN, DOWN], [[0.0, 0.1]] * 2 + [[0.0, -0.1]] * 2, mu=0.5)


def repeated_contact() -> ContactProblem:
    """The same vertex listed three times: every pair of them is singular."""
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
    """A fresh workspace of a step."""
    return np.zeros(1, STEP_WORK).view(np.recarray)[0]


def posed(problem: ContactProblem) -> StepWork:
    """A workspace with the contacts of a problem."""
    work = workspace()
    work.A[:] = problem.A
    work.contacts[:] = rows(problem)
    return work
