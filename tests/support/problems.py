"""Parts to squeeze, shared by tests and benchmarks; docstrings say what is special about each.

Outlines are counter-clockwise, in mm, with their area centroid at the origin.
"""

import math
from collections.abc import Callable

import numpy as np
import shapely
from scipy.spatial.distance import pdist

from planner.belief.observation import Encoder
from planner.mechanics.clearance import STANDS_ON, Jaws, classify_contact
from planner.mechanics.limit_surface import LimitSurface, fit_ellipsoid
from planner.mechanics.simulator import DEFAULT_STEP_MM, RollOut, Simulator
from planner.part.outline import canonical, radius_of_gyration
from planner.part.pressure import Pressure, support

JAWS = Jaws(85.0, 27.5, 9.5, 0.5)
"""The paper's gripper."""
ENCODER = Encoder(85.0, 227, 0.15)
"""The encoder of the 2F-85: opening [mm], steps and noise [mm]."""
LONG_JAWS = JAWS._replace(length_mm=400.0)
"""Jaws with fingers longer than any part: no part reaches their ends."""


def rectangle() -> np.ndarray:
    """The paper's rectangle, 30 x 21 mm: it can jam on a diagonal, and a flush grasp has four contacts."""
    return canonical([[0, 0], [30, 0], [30, 21], [0, 21]]).outline_mm


def butterfly() -> np.ndarray:
    """Two lobes, 36 x 22 mm, about a waist of 12.7 mm: concave, with many vertices near each contact."""
    t = np.arange(96) * math.tau / 96
    y = np.sin(t) * (6.35 + 18.3 * np.cos(t) ** 2)
    return canonical(np.column_stack([18 * np.cos(t), y])).outline_mm


def right_triangle() -> np.ndarray:
    """A triangle with legs of 36 and 26 mm: it has no symmetry, and its faces lie opposite a vertex."""
    return canonical([[0, 0], [36, 0], [0, 26]]).outline_mm


def hexagon() -> np.ndarray:
    """A regular hexagon, 28 mm across corners: its faces are parallel in pairs, so that grasps are flush."""
    return regular_polygon(6, 14.0)


def ellipse() -> np.ndarray:
    """An ellipse, 36 x 22 mm in 72 vertices: as it turns, contacts move from one vertex to the next."""
    t = np.arange(72) * math.tau / 72
    return canonical(np.column_stack([18 * np.cos(t), 11 * np.sin(t)])).outline_mm


def l_shape() -> np.ndarray:
    """An L, 32 x 26 mm with arms of 12 mm: a finger's corner can enter the notch."""
    return canonical([[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]]).outline_mm


def bar() -> np.ndarray:
    """A bar, 60 x 12 mm: longer than the fingers, which hold it by nothing but their corners."""
    return canonical([[0, 0], [60, 0], [60, 12], [0, 12]]).outline_mm


def disc() -> np.ndarray:
    """A disc of radius 13 mm in 90 vertices: its width does not depend on its angle.

    Neighbouring edges are nearly parallel.
    """
    return regular_polygon(90, 13.0)


def sliver() -> np.ndarray:
    """A sliver, 30 x 0.15 mm: thinner than one step of the closing fingers, and longer than the fingers."""
    return canonical([[0, 0], [30, 0], [30, 0.15], [0, 0.15]]).outline_mm


def regular_polygon(vertices: int, radius: float) -> np.ndarray:
    """A regular polygon with a vertex on the x axis; `radius` is that of its corners [mm]."""
    t = np.arange(vertices) * math.tau / vertices
    return canonical(radius * np.column_stack([np.cos(t), np.sin(t)])).outline_mm


OUTLINES: dict[str, Callable[[], np.ndarray]] = {
    "rectangle": rectangle,
    "butterfly": butterfly,
    "right triangle": right_triangle,
    "hexagon": hexagon,
    "ellipse": ellipse,
    "L": l_shape,
    "bar 60 x 12": bar,
    "disc": disc,
}
"""The eight parts of the convergence table."""


def random_star(
    rng: np.random.Generator, vertices: int, smallest: float = 6.0, largest: float = 24.0
) -> np.ndarray:
    """A random star-shaped polygon: simple, mostly concave, with some sharp corners.

    The vertices lie between `smallest` and `largest` [mm] from its middle.
    """
    gaps = rng.dirichlet(np.full(vertices, 4.0)) * math.tau
    angles = rng.uniform(0, math.tau) + np.cumsum(gaps)
    radius = rng.uniform(smallest, largest, vertices)
    return canonical(radius[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])).outline_mm


def random_convex(rng: np.random.Generator, vertices: int) -> np.ndarray:
    """A random convex polygon without parallel faces, inscribed in an ellipse of semi-axes 10 to 20 mm."""
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
    turned = rng.uniform(-math.pi, math.pi, n)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), turned])


def boundary_surface(outline: np.ndarray) -> LimitSurface:
    """Returns the limit surface of a part whose pressure is spread evenly along its outline: an ellipsoid.

    The paper assumes this pressure.
    """
    points, weights = support(Pressure("boundary", 100), outline)
    return fit_ellipsoid(points, weights, radius_of_gyration(outline))


def simulator(
    outline: np.ndarray,
    jaws: Jaws = JAWS,
    step_mm: float = DEFAULT_STEP_MM,
    workers: int = 1,
    surface: LimitSurface | None = None,
) -> Simulator:
    """Returns a simulator of a part; by default, the part's pressure is spread evenly along its outline."""
    return Simulator(
        outline=outline,
        surface=surface or boundary_surface(outline),
        jaws=jaws,
        friction=(0.4, 0.6),
        wishart_dof=100,
        step_mm=step_mm,
        workers=workers,
    )


def rolled(
    outline: np.ndarray, n: int, radius: float, seed: int, surface: LimitSurface | None = None
) -> RollOut:
    """Squeezes a part at each of n random poses about the hand; returns the roll-out.

    Poses are left out if an open finger would stand on the part.
    """
    part, rng = simulator(outline, workers=2, surface=surface), np.random.default_rng(seed)
    poses = random_poses(rng, n, radius)
    poses = poses[classify_contact(part.outline, part.jaws, poses) != STANDS_ON]
    return part.roll_out(poses, part.sample(len(poses), rng))


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    """Points (..., 2), turned about the origin by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points, float) @ np.array([[c, s], [-s, c]])


def place(outline: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Vertices (N, 2) of the outline at a pose (3,)."""
    return np.ascontiguousarray(turned(outline, pose[2]) + pose[:2])


def finger_box(finger: int, face: float) -> shapely.Polygon:
    """The finger (+1 upper, -1 lower) whose inner face lies at y = face."""
    half, outer = JAWS.length_mm / 2, face + finger * JAWS.thickness_mm
    return shapely.box(-half, min(face, outer), half, max(face, outer))


def overlap_depth(points: np.ndarray, box: shapely.Polygon) -> float:
    """Returns how deep a part overlaps a finger [mm].

    This is the greatest depth of a vertex of the part in the finger, or of a finger's corner in the part.

    Args:
        points: vertices of the part.
        box: outline of the finger.
    """
    part, depths = shapely.Polygon(points), [0.0]
    for shape, inner in ((box, points), (part, shapely.get_coordinates(box)[:4])):
        inside = shapely.points(inner[shapely.contains_xy(shape, inner[:, 0], inner[:, 1])])
        depths += shapely.distance(shape.exterior, inside).tolist()
    return max(depths)


def deepest_overlap(outline: np.ndarray, pose: np.ndarray, width: float) -> float:
    """Returns the greatest depth to which a part overlaps one of two fingers `width` apart [mm]."""
    points = place(outline, pose)
    return max(overlap_depth(points, finger_box(f, f * width / 2)) for f in (1, -1))


def diameter(outline):
    """Largest distance between two vertices of an outline [mm]."""
    return float(pdist(outline).max())
