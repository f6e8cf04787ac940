"""A second squeeze simulator: slow, obvious, and built another way than the kernels.

scipy's `solve_ivp` integrates the part's velocity over s, the distance that each finger has closed. At every
pose geometry gives the contacts, and the velocity is that of a consistent mode of these contacts
(`lcp_twin.motions`). A contact with a gap g may close at the rate g / `REACH_MM`, so that the velocity does
not jump at a touch. If no mode is consistent, the part is held. The simulator shares no code with
`planner.mechanics`; it is meant for polygons of few vertices.
"""

import math
from typing import NamedTuple

import numpy as np
import shapely
from contact_problems import ContactProblem
from lcp_twin import motions
from problems import place
from scipy.integrate import solve_ivp

from planner.mechanics.clearance import Jaws

REACH_MM = 0.01
"""Gap below which a pair of features counts as a contact; results are accurate to a few times as much."""
BESIDE_MM = 0.1
"""A vertex that is less deep than this behind a finger's face touches the face, a deeper one the end."""
MOST_CONTACTS = 4


class Part(NamedTuple):
    """A part and the jaws that squeeze it.

    Attributes:
        outline: (N, 2) vertices, counter-clockwise, mm.
        A: (3, 3) limit surface matrix in the part's frame.
        rho: the length that normalises A, mm.
        mu: friction at both fingers.
        jaws: the jaws; here both fingers close equally far, whatever shares the jaws state.
    """

    outline: np.ndarray
    A: np.ndarray
    rho: float
    mu: float
    jaws: Jaws


class Result(NamedTuple):
    """Final pose (3,), width in mm, and whether the part is held."""

    pose: np.ndarray
    width_mm: float
    held: bool


class HeldError(Exception):
    """Raised where no mode of the contacts is consistent: the part is held."""


def squeeze(part: Part, pose: np.ndarray) -> Result:
    """Closes the fingers from fully open until they hold the part or meet; returns where the part ends."""
    closed = _first_touch(part, pose)
    end = 0.5 * part.jaws.opening_mm
    if closed >= end:
        return Result(np.array(pose), 0.0, False)
    last = np.array([closed, *pose])

    def velocity(s: float, q: np.ndarray) -> np.ndarray:
        return _velocity(part, s, q)

    def remember(s: float, q: np.ndarray) -> float:
        last[:] = s, *q
        return 1.0

    steps = {"max_step": 0.05, "rtol": 1e-5, "atol": 1e-5}
    try:
        solve_ivp(velocity, (closed, end), np.array(pose), events=remember, **steps)
    except HeldError:
        return Result(last[1:].copy(), 2.0 * (end - last[0]), True)
    return Result(last[1:].copy(), 0.0, False)


def _first_touch(part: Part, pose: np.ndarray) -> float:
    """Returns how far each finger closes before one touches the part [mm]; infinite if none touches it."""
    opening, length, _ = part.jaws[:3]
    strip = shapely.box(-length / 2, -opening, length / 2, opening)
    between = shapely.Polygon(place(part.outline, pose)).intersection(strip)
    if between.is_empty:
        return math.inf
    _, low, _, high = between.bounds
    return min(opening / 2 - high, opening / 2 + low)


def _velocity(part: Part, s: float, q: np.ndarray) -> np.ndarray:
    """Returns the part's velocity d(x, y, theta) / ds at the pose q, once each finger has closed by s."""
    touched = sorted(_contacts(part, s, q))[:MOST_CONTACTS]
    if not touched:
        return np.zeros(3)
    gap, finger, *places = np.array(touched).T
    advance = np.column_stack([0.0 * finger, -finger])
    return rate(part, q, np.array(places).T, advance, np.maximum(gap / REACH_MM, -1.0))


def rate(
    part: Part, q: np.ndarray, places: np.ndarray, advance: np.ndarray, gap: np.ndarray
) -> np.ndarray:
    """Returns the velocity (3,) of a part that is touched at m contacts.

    Args:
        part: the part.
        q: (3,) pose of the part.
        places: (m, 4) point of each contact, and normal into the part.
        advance: (m, 2) velocity of finger or pusher at each contact.
        gap: (m,) speed at which finger and part may approach each other at each contact.

    Raises:
        HeldError: no motion is consistent.
    """
    c, s = math.cos(q[2]), math.sin(q[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    A, mu = turn @ part.A @ turn.T, np.full(len(gap), part.mu)
    points = places[:, :2] - q[:2]
    consistent = motions(ContactProblem(A, part.rho, points, places[:, 2:], advance, gap, mu))
    if len(consistent) == 0:
        raise HeldError
    return consistent[0] / [1.0, 1.0, part.rho]


def _contacts(part: Part, s: float, q: np.ndarray) -> list[tuple[float, ...]]:
    """Returns all contacts, also of features that nearly touch: (gap, finger, point x, y, normal x, y)."""
    opening, length, thickness = part.jaws[:3]
    half, points = length / 2, place(part.outline, q)
    result: list[tuple[float, ...]] = []
    for finger in (1, -1):
        face = finger * (opening / 2 - s)
        for x, y in points:
            gap, beyond = finger * (face - y), abs(x) - half
            if beyond <= 0.0 and -BESIDE_MM < gap < REACH_MM:
                result.append((gap, finger, x, y, 0.0, -finger))
            if -thickness < gap < -BESIDE_MM and abs(beyond) < REACH_MM:
                result.append((beyond, finger, x, y, math.copysign(1.0, x), 0.0))
        for side in (-1, 1):
            result += _corner_contacts(points, finger, np.array([side * half, face]), side)
    return result


def _corner_contacts(
    points: np.ndarray, finger: int, corner: np.ndarray, side: int
) -> list[tuple[float, ...]]:
    """Returns the contacts of an inner corner of a finger with edges of the part, in the form of `_contacts`.

    An edge is left out if its force on the corner would point out of the finger.
    """
    results: list[tuple[float, ...]] = []
    for first, second in zip(points, np.roll(points, -1, axis=0), strict=True):
        edge = second - first
        size = math.hypot(*edge)
        inward = np.array([-edge[1], edge[0]]) / size
        along = (corner - first) @ edge / size
        gap = -(corner - first) @ inward
        # The part pushes the corner along -inward, which must not point out of the finger.
        in_cone = -finger * inward[1] > -1e-3 and side * inward[0] > -1e-3
        if in_cone and 0.0 <= along <= size and -BESIDE_MM < gap < REACH_MM:
            touched = corner + gap * inward
            results.append((gap, finger, touched[0], touched[1], inward[0], inward[1]))
    return results
