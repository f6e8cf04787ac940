"""Random pushes by the gripper's hand end nearly alike in each variant; no part ends inside a finger.

A variant computes the same push in another way, for example with another step or in two pieces.
`tests/bench/bench_push_invariance.py` is the same study with 3000 pushes of each shape.
"""

import numpy as np
import pytest
from problems import JAWS, rectangle, simulator
from push_study import ALLOWED, OVERLAP_MM2, SHAPES, STEPS_ALLOWED, studied

SAMPLE = 1000
FLUSH_MM = 0.02


@pytest.mark.parametrize("shape", SHAPES)
def test_push_by_hand_computed_otherwise_ends_alike(shape):
    shares = studied(SHAPES[shape](), SAMPLE, 7)
    overlap = shares.pop("overlap_mm2")
    for variant, share in shares.items():
        assert share <= (STEPS_ALLOWED if variant.startswith("step") else ALLOWED), variant
    assert overlap <= OVERLAP_MM2


@pytest.mark.parametrize("opening", [0.0, 8.0, 12.0, 20.0])
@pytest.mark.parametrize("beside", [0.0, 0.01, -0.3])
def test_push_by_hand_flush_part_stays_flush(opening, beside):
    """The fingers touch the part's side on both sides of its centre, so the limit surface has no effect."""
    n = 100
    start = np.tile([JAWS.length_mm / 2 + 16.0, beside, 0.0], (n, 1))
    end = simulator(rectangle()).push_by_hand(
        start, np.full(n, opening), np.full(n, 40.0), np.random.default_rng(0)
    )
    assert end == pytest.approx(start + np.array([39.0, 0.0, 0.0]), abs=FLUSH_MM)


def test_push_by_hand_wedged_part_moves_along_from_start():
    """A first push wedges the part's tip between the fingers; in a second, the part moves at once."""
    tip = np.array([[-24.0, 0.0], [12.0, -14.5], [12.0, 14.5]])
    part, n, opening = simulator(tip), 200, np.full(200, 12.0)
    rng = np.random.default_rng(2)
    ahead = np.column_stack(
        [np.full(n, JAWS.length_mm / 2 + 25.0), rng.uniform(-2, 2, n), rng.uniform(-0.1, 0.1, n)]
    )
    first, second = (np.random.default_rng(3) for _ in range(2))
    wedged = part.push_by_hand(ahead, opening, np.full(n, 40.0), first) - [40.0, 0.0, 0.0]
    again = part.push_by_hand(wedged, opening, np.full(n, 15.0), second)
    assert again[:, 0] == pytest.approx(wedged[:, 0] + 15.0, abs=0.5)
