"""The look-ahead, on squeezes whose outcome is known."""

import numpy as np
from oracle import BELIEF, RISKY, SILENT, TELLING, look_ahead


def test_the_squeeze_that_tells_two_poses_apart_is_chosen():
    (choice,) = look_ahead([SILENT, TELLING]).choose(BELIEF, np.random.default_rng(0))
    assert choice.placement[2] == TELLING
    assert choice.gain > 0.4


def test_nothing_is_chosen_where_nothing_tells():
    assert look_ahead([SILENT]).choose(BELIEF, np.random.default_rng(0)) == []


def test_a_price_on_risk_decides_between_equals():
    rng = np.random.default_rng(0)
    assert look_ahead([RISKY, TELLING], unstable=0.1).choose(BELIEF, rng)[0].placement[2] == TELLING
    assert look_ahead([RISKY, TELLING]).choose(BELIEF, rng)[0].placement[2] == RISKY


def test_no_hand_is_set_down_on_the_part():
    spread = np.array([[0.0, y, 0.0] for y in np.linspace(-60.0, 60.0, 50)])
    assert look_ahead([TELLING]).choose(spread, np.random.default_rng(0)) == []
