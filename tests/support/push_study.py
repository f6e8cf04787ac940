"""Simulates pushes by the robot's hand, each in several variants that should end alike.

The variants have the same parts, the same mechanics and the same way. They differ in how the push is
computed: with another step, in two pushes instead of one, with the vertices in another order, and so on.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import shapely
from problems import JAWS, bar, place, rectangle, right_triangle, simulator
from programs import TREES

from planner.job import model as job_file
from planner.mechanics.simulator import Simulator
from planner.part.outline import reach

WAY_MM, FIRST_MM = 40.0, 25.0
CLOSE_MM, CLOSE_RAD = 0.5, 0.02
ALLOWED, STEPS_ALLOWED, OVERLAP_MM2 = 0.001, 0.005, 0.1
"""Limits: share of pushes that end elsewhere, this share for variants with another step, and overlap."""
OPENINGS = (0.0, 1.0, 12.0, 21.25, 42.5)  # openings of the jaws [mm]


def of_tree(name: str) -> np.ndarray:
    """Returns the outline of the part whose job is in the folder `name` of `trees/`."""
    return np.asarray(Simulator.of_job(job_file.load(TREES / name / "job.toml"), 1).outline)


OF_TREES = ("butterfly-15", "hex-nut", "angle-cleat", "oval-cover")
SHAPES: dict[str, Callable[[], np.ndarray]]
SHAPES = {"rectangle": rectangle, "right triangle": right_triangle, "bar": bar}
SHAPES |= {name: partial(of_tree, name) for name in OF_TREES}


def scattered(outline: np.ndarray, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws poses (n, 3) of parts in front of a hand, in the hand's frame, and openings (n,) of the jaws."""
    rng = np.random.default_rng(seed)
    ahead = JAWS.length_mm / 2 + reach(outline) + rng.uniform(0.1, 8.0, n)
    poses = np.column_stack([ahead, rng.uniform(-15.0, 15.0, n), rng.uniform(-np.pi, np.pi, n)])
    return poses, rng.choice(OPENINGS, n)


def pushed(
    part: Simulator, poses: np.ndarray, opening: np.ndarray, way_mm: float, seed: int
) -> np.ndarray:
    """Pushes parts by a hand that moves by `way_mm`; returns their final poses (n, 3).

    The seed determines the mechanics of the parts, such as friction.
    """
    ways, rng = np.full(len(poses), way_mm), np.random.default_rng(seed)
    return part.push_by_hand(poses, opening, ways, rng)


def divided(outline: np.ndarray) -> np.ndarray:
    """The same outline with each edge cut into three, by vertices that do not change the shape."""
    edges = np.roll(outline, -1, axis=0) - outline
    cuts = [outline + k / 3 * edges for k in range(3)]
    return np.concatenate(cuts, axis=1).reshape(-1, 2)


def in_two(part: Simulator, poses: np.ndarray, opening: np.ndarray, seed: int) -> np.ndarray:
    """Pushes parts along the whole way in two pushes instead of one; returns their final poses (n, 3)."""
    there = np.array([FIRST_MM, 0.0, 0.0])
    halfway = pushed(part, poses, opening, FIRST_MM, seed) - there
    return pushed(part, halfway, opening, WAY_MM - FIRST_MM, seed) + there


def variants(
    part: Simulator, poses: np.ndarray, opening: np.ndarray, seed: int
) -> dict[str, np.ndarray]:
    """Returns the final poses (n, 3) of the parts in each variant, by name; "as it is" is the reference."""

    def whole(ours: Simulator, start: np.ndarray = poses) -> np.ndarray:
        return pushed(ours, start, opening, WAY_MM, seed)

    return {
        "as it is": whole(part),
        "in two pushes": in_two(part, poses, opening, seed),
        "vertices in another order": whole(replace(part, outline=np.roll(part.outline, 1, axis=0))),
        "collinear vertices": whole(replace(part, outline=divided(part.outline))),
        "1e-9 mm of start": whole(part, poses + np.array([1e-9, -1e-9, 0.0])),
        "step of 0.1 mm": whole(replace(part, step_mm=0.1)),
        "step of 0.8 mm": whole(replace(part, step_mm=0.8)),
    }


def differ(ends: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns a mask (n,): which poses differ from the others by more than `CLOSE_MM` or `CLOSE_RAD`."""
    off = others - ends
    turned = np.abs(np.remainder(off[:, 2] + np.pi, 2.0 * np.pi) - np.pi)
    return (np.hypot(off[:, 0], off[:, 1]) > CLOSE_MM) | (turned > CLOSE_RAD)


def fingers_at(opening_mm: float, way_mm: float) -> shapely.Geometry:
    """The outlines of the fingers of a hand that has moved by `way_mm`."""
    inner, outer, h = opening_mm / 2, opening_mm / 2 + JAWS.thickness_mm, JAWS.length_mm / 2
    return shapely.union_all(shapely.box(way_mm - h, [inner, -outer], way_mm + h, [outer, -inner]))


def overlaps(outline: np.ndarray, ends: np.ndarray, opening: np.ndarray) -> np.ndarray:
    """Areas (n,) in which parts at the poses `ends` overlap the fingers after the push [mm^2]."""
    hands = {value: fingers_at(value, WAY_MM) for value in np.unique(opening)}
    parts = [shapely.Polygon(place(outline, pose)) for pose in ends]
    pairs = zip(parts, opening, strict=True)
    return np.array([shapely.intersection(each, hands[value]).area for each, value in pairs])


def studied(outline: np.ndarray, n: int, seed: int) -> dict[str, float]:
    """Returns by variant the share of n pushes that end elsewhere than in the reference.

    "overlap_mm2" is the largest area in which part and fingers overlap after a push of the reference.
    """
    part = simulator(outline)
    poses, opening = scattered(outline, n, seed)
    ends = variants(part, poses, opening, seed)
    reference = ends.pop("as it is")
    shares = {name: float(differ(reference, other).mean()) for name, other in ends.items()}
    return shares | {"overlap_mm2": float(overlaps(outline, reference, opening).max())}
