"""Outlines and contact problems shared by tests and benches, each with what is odd about it.

Outlines are counter-clockwise, in mm, with their area centroid at the origin. A `ContactProblem` is one
instant of contact: `lcp` poses it as eqs 1-5 of the paper, `rows` as the kernels' arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import shapely

from planner.mechanics import contacts
from planner.mechanics.limit_surface import LimitSurface, fit_ellipsoid
from planner.mechanics.simulator import DEFAULT_STEP_MM, Simulator
from planner.part.outline import canonical, radius_of_gyration
from planner.part.pressure import Pressure, support

JAWS = np.array([85.0, 27.5, 9.5, 0.5])
"""The paper's gripper: opening, finger length and thickness (mm), the upper finger's share of the closing."""
LONG_JAWS = np.array([85.0, 400.0, 9.5, 0.5])
"""Fingers longer than any part: nothing reaches their ends."""


def rectangle() -> np.ndarray:
    """The paper's 30 x 21 mm: it jams on its diagonals, and its flush grasps have four contacts."""
    return canonical([[0, 0], [30, 0], [30, 21], [0, 21]]).outline_mm


def butterfly(vertices: int = 96) -> np.ndarray:
    """Two lobes, 36 x 22 mm, about a waist of 12.7 mm: concave, and dense enough for many near contacts."""
    t = np.arange(vertices) * math.tau / vertices
    return canonical(np.column_stack([18 * np.cos(t), np.sin(t) * (6.35 + 18.3 * np.cos(t) ** 2)])).outline_mm


def right_triangle() -> np.ndarray:
    """Legs of 36 and 26 mm: no symmetry, and faces that lie opposite a single vertex."""
    return canonical([[0, 0], [36, 0], [0, 26]]).outline_mm


def hexagon() -> np.ndarray:
    """Regular, 28 mm across corners: three pairs of parallel faces, so every grasp is flush."""
    return regular_polygon(6, 14.0)


def ellipse() -> np.ndarray:
    """36 x 22 mm in 72 vertices: smooth, so that contacts roll from vertex to vertex without end."""
    t = np.arange(72) * math.tau / 72
    return canonical(np.column_stack([18 * np.cos(t), 11 * np.sin(t)])).outline_mm


def l_shape() -> np.ndarray:
    """32 x 26 mm with arms of 12 mm: a finger's corner can enter the notch."""
    return canonical([[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]]).outline_mm


def bar() -> np.ndarray:
    """60 x 12 mm: longer than the fingers, and held by nothing but their corners."""
    return canonical([[0, 0], [60, 0], [60, 12], [0, 12]]).outline_mm


def disc() -> np.ndarray:
    """Radius 13 mm in 90 vertices: its width says nothing of its angle, its edges are nearly parallel."""
    return regular_polygon(90, 13.0)


def sliver() -> np.ndarray:
    """30 x 0.15 mm: thinner than one step of the fingers, and longer than they are."""
    return canonical([[0, 0], [30, 0], [30, 0.15], [0, 0.15]]).outline_mm


def regular_polygon(vertices: int, radius: float) -> np.ndarray:
    """Regular polygon with a vertex on the x axis."""
    t = np.arange(vertices) * math.tau / vertices
    return canonical(radius * np.column_stack([np.cos(t), np.sin(t)])).outline_mm


OUTLINES: dict[str, Callable[[], np.ndarray]] = {
    "rectangle": rectangle, "butterfly": butterfly, "right triangle": right_triangle, "hexagon": hexagon,
    "ellipse": ellipse, "L": l_shape, "bar 60 x 12": bar, "disc": disc,
}  # fmt: skip
"""The eight parts of the convergence table."""


def random_star(
    rng: np.random.Generator, vertices: int, smallest: float = 6.0, largest: float = 24.0
) -> np.ndarray:
    """Star-shaped polygon, vertices that far from its middle: simple, mostly concave, some corners sharp."""
    gaps = rng.dirichlet(np.full(vertices, 4.0)) * math.tau
    angles = rng.uniform(0, math.tau) + np.cumsum(gaps)
    radius = rng.uniform(smallest, largest, vertices)
    return canonical(radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])).outline_mm


def random_convex(rng: np.random.Generator, vertices: int) -> np.ndarray:
    """Polygon inscribed in a random ellipse, of semi-axes 10 to 20 mm: convex, with no two faces parallel."""
    while True:
        angles = np.sort(rng.uniform(0, math.tau, vertices))
        gaps = np.diff(angles, append=angles[0] + math.tau)
        if gaps.min() > 0.2 and gaps.max() < 0.9 * math.pi:
            break
    axes = rng.uniform(10.0, 20.0, 2)
    return canonical(axes * np.column_stack([np.cos(angles), np.sin(angles)])).outline_mm


def random_poses(rng: np.random.Generator, n: int, radius: float) -> np.ndarray:
    """Poses (n, 3): centres uniform in a disc about the hand, orientations uniform."""
    r, angle = radius * np.sqrt(rng.random(n)), rng.uniform(0, math.tau, n)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), rng.uniform(-math.pi, math.pi, n)])


def boundary_surface(outline: np.ndarray) -> LimitSurface:
    """The ellipsoid of pressure spread evenly along the outline, as the paper assumes."""
    points, weights = support(Pressure("boundary", 100), outline)
    return fit_ellipsoid(points, weights, radius_of_gyration(outline))


def simulator(
    outline: np.ndarray, jaws: np.ndarray = JAWS, step_mm: float = DEFAULT_STEP_MM, workers: int = 1,
    surface: LimitSurface | None = None,
) -> Simulator:  # fmt: skip
    """A simulator of that part on evenly spread pressure."""
    return Simulator(
        outline=outline, surface=surface or boundary_surface(outline), jaws=jaws, friction=(0.4, 0.6),
        wishart_dof=100, step_mm=step_mm, workers=workers,
    )  # fmt: skip


def place(outline: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Vertices (N, 2) of the outline at a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.ascontiguousarray(outline @ np.array([[c, s], [-s, c]]) + pose[:2])


def finger_box(finger: int, face: float, jaws: np.ndarray = JAWS) -> shapely.Polygon:
    """The finger (+1 upper, -1 lower) whose inner face lies at y = face."""
    half, outer = jaws[1] / 2, face + finger * jaws[2]
    return shapely.box(-half, min(face, outer), half, max(face, outer))


def overlap_depth(points: np.ndarray, box: shapely.Polygon) -> float:
    """How deep a vertex of the part is in the finger, or a finger's corner in the part, by shapely, mm."""
    part, depths = shapely.Polygon(points), [0.0]
    for shape, inner in ((box, points), (part, shapely.get_coordinates(box)[:4])):
        inside = shapely.points(inner[shapely.contains_xy(shape, inner[:, 0], inner[:, 1])])
        depths += shapely.distance(shape.exterior, inside).tolist()
    return max(depths)


def deepest_overlap(outline: np.ndarray, pose: np.ndarray, width: float, jaws: np.ndarray = JAWS) -> float:
    """Deepest overlap of a part with either finger, of jaws that are `width` apart, in mm."""
    points = place(outline, pose)
    return max(overlap_depth(points, finger_box(f, f * width / 2, jaws)) for f in (1, -1))


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
    N, T = (
        np.column_stack([f, (problem.points[:, 0] * f[:, 1] - problem.points[:, 1] * f[:, 0]) / problem.rho])
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


def rows(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """The same contacts as the kernels' arrays C and I; even ones belong to the upper finger."""
    N, T = wrenches(problem)
    m = len(N)
    C = np.zeros((contacts.MAX_CONTACTS, contacts.C_COLUMNS))
    C[:m, [contacts.RX, contacts.RY]] = problem.points
    C[:m, [contacts.NX, contacts.NY]] = problem.normals
    C[:m, contacts.GAP] = problem.gap
    C[:m, contacts.N2], C[:m, contacts.T2] = N[:, 2], T[:, 2]
    normal, tangential = goals(problem)
    C[:m, contacts.UN], C[:m, contacts.UT] = normal + problem.gap, tangential
    I = np.zeros((contacts.MAX_CONTACTS, contacts.I_COLUMNS), np.int64)
    I[:m, contacts.FINGER] = np.where(np.arange(m) % 2 == 0, 1, -1)
    return C, I


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
        A=root @ root.T + 0.2 * np.eye(3), rho=10.0, points=rng.uniform(-20, 20, (m, 2)),
        normals=np.column_stack([np.cos(angle), np.sin(angle)]),
        advance=np.column_stack([np.zeros(m), closing]),
        gap=np.where(rng.random(m) < 0.33, rng.uniform(0, 0.2, m), 0.0), mu=mu,
    )  # fmt: skip


def _problem(points: list, normals: list, advance: list, mu: float, gap: float = 0.0) -> ContactProblem:
    m = len(points)
    return ContactProblem(
        np.diag([1.05, 1.05, 0.58]), 10.0, np.array(points, float), np.array(normals, float),
        np.array(advance, float), np.full(m, gap), np.full(m, mu),
    )  # fmt: skip


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


def wedged() -> ContactProblem:
    """A finger's corner deep in a notch of 60 degrees, the other finger below: no way out."""
    left, right = math.radians(-60.0), math.radians(-120.0)
    normals = [[math.cos(left), math.sin(left)], [math.cos(right), math.sin(right)], UP]
    return _problem(
        [[-0.1, 3.0], [0.1, 3.0], [0.0, -6.0]], normals, [[0.0, -0.1], [0.0, -0.1], [0.0, 0.1]], mu=0.4
    )


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


HAVE_MOTION = {"sticking": sticking, "sliding": sliding, "receding": receding, "flush push": flush_push,
               "repeated contact": repeated_contact}  # fmt: skip
HAVE_NONE = {"jamming": jamming, "wedged": wedged, "flush grasp": flush_grasp}
