"""The subspaces of a part: the four of the paper's rectangle, free space, and merged widths."""

import math

import numpy as np
import pytest
from problems import ENCODER, rectangle, rolled

from planner.belief.observation import resolution_of
from planner.mechanics.squeeze import GRASPED, JAMMED
from planner.paper.subspaces import subspaces_of


@pytest.fixture(scope="module")
def squeezed():
    return rolled(rectangle(), 12_000, 38.25, seed=2)


def test_subspaces_of_rectangle_are_the_four_of_the_paper(squeezed):
    # Fig. 4: free space, grasps at the long edges, grasps at the short edges, jams between diagonal vertices.
    subspaces = subspaces_of(squeezed.width_mm, ENCODER)
    assert len(subspaces) == 4
    label = subspaces.label(squeezed.width_mm)
    widths = [squeezed.width_mm[label == k] for k in range(4)]
    least, most = [each.min() for each in widths], [each.max() for each in widths]
    assert most[0] == 0.0
    assert least[1:3] == pytest.approx([21.0, 30.0], abs=0.05)
    assert most[3] == pytest.approx(math.hypot(30.0, 21.0), abs=0.05)
    held = (squeezed.status == GRASPED) | (squeezed.status == JAMMED)
    assert np.array_equal(label > 0, held)
    assert not np.any(squeezed.status[label == 3] == GRASPED)


@pytest.mark.parametrize("width", [np.zeros(10), np.full(10, 26.0), np.zeros(0)])
def test_subspaces_of_any_widths_begin_with_free_space(width):
    subspaces = subspaces_of(width, ENCODER)
    assert np.array_equal(subspaces.label(np.zeros(3)), np.zeros(3))
    assert subspaces.size.sum() == len(width)
    assert len(subspaces) == 1 + bool(np.any(width > 0.0))


def test_subspaces_of_widths_within_the_resolution_are_one():
    near = 0.5 * resolution_of(ENCODER).apart * ENCODER.mm_per_step
    for gap, subspaces in ((near, 2), (4.0 * near, 3)):
        width = np.repeat([40.0, 40.0 + gap], 1000)
        assert len(subspaces_of(width, ENCODER)) == subspaces
