"""The squeeze kernels against a twin with another formulation, integrator and contact search."""

import math

import numpy as np
import pytest
from problems import JAWS, OUTLINES, deepest_overlap, random_poses, simulator
from twin import Part, squeeze

CLOSE_MM, CLOSE_RAD = 0.3, math.radians(1.0)


def poses_clear_of_the_fingers(outline, seed, count, radius):
    """Random poses at which the open fingers do not stand on the part."""
    poses = random_poses(np.random.default_rng(seed), 4 * count, radius)
    clear = [p for p in poses if deepest_overlap(outline, p, JAWS.opening_mm) == 0.0]
    return np.array(clear[:count])


@pytest.mark.parametrize(
    ("name", "mu", "count"),
    [("rectangle", 0.5, 2), ("rectangle", 0.2, 1), ("right triangle", 0.5, 2), ("L", 0.3, 1)],
)
def test_roll_out_ends_like_twin(name, mu, count):
    outline = OUTLINES[name]()
    part = simulator(outline)
    poses = poses_clear_of_the_fingers(outline, 21, count, 16.0)
    result = part.roll_out(poses, part.nominal(count, mu))
    assert not result.given_up.any()
    for pose, final, width in zip(poses, result.poses, result.width_mm, strict=True):
        twin = squeeze(Part(outline, part.surface.A, part.surface.rho_mm, mu, JAWS), pose)
        assert twin.held == (width > 0.0)
        assert math.hypot(*(twin.pose - final)[:2]) < CLOSE_MM
        assert abs(twin.pose[2] - final[2]) < CLOSE_RAD
        assert abs(twin.width_mm - width) < CLOSE_MM
