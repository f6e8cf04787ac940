"""Whether closed jaws hold a part at a leaf's pose, also with a finger in a slot."""

from math import pi

import numpy as np
import pytest
from shapely import LineString, Polygon

from runtime.table.grip import Grip, _blocks, _is_held, _shape

# A U of 28 x 34 mm: arms 8 mm wide, the slot between them 12 mm wide and 18 mm deep.
FORK = [(-14, -15), (14, -15), (14, 19), (6, 19), (6, 1), (-6, 1), (-6, 19), (-14, 19)]
SHAPE = _shape([(float(x), float(y)) for x, y in FORK])


def held(width_mm: float, pose: tuple[float, float, float]) -> bool:
    """Whether jaws `width_mm` apart, with their middle at the origin, hold the fork at a pose."""
    grip = Grip((0.0, 0.0, 0.0), 13.75, -width_mm / 2, width_mm / 2, 1.0)
    return _is_held(SHAPE, pose, grip, 0.0)


@pytest.mark.parametrize(
    ("width_mm", "pose", "expected"),
    [
        (28.0, (0.0, 0.0, pi / 2), True),  # across both arms
        (34.0, (0.0, 2.0, 0.0), False),  # the hand stands 4 mm beside the middle of 34 mm
        (34.0, (0.0, -2.0, 0.0), True),
        (8.0, (-20.0, 10.0, -pi / 2), True),  # about one arm: a finger stands in the slot
        (12.0, (-20.0, 0.0, -pi / 2), False),  # about the slot alone: arms fill the fingers' place
        # About one arm, but the closed end fills the place of a finger.
        (8.0, (0.0, 10.0, -pi / 2), False),
        (8.0, (0.0, 60.0, 0.0), False),  # far away
    ],
)
def test_is_held_fork_matches_rigid_fingers(width_mm, pose, expected):
    assert held(width_mm, pose) == expected


def test_blocks_equals_the_intersection_of_polygon_and_line():
    rng, polygon = np.random.default_rng(3), Polygon(FORK)
    outline = [(float(x), float(y)) for x, y in FORK]
    for y, half in zip(rng.uniform(-25, 25, 300), rng.uniform(0.1, 20, 300), strict=True):
        inside = polygon.intersection(LineString([(-half, y), (half, y)])).length
        assert _blocks(outline, float(y), float(half)) == (inside > 1e-9)
