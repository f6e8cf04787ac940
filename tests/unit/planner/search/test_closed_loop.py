"""The look-ahead, on squeezes whose outcome is known."""

import numpy as np
from oracle import BELIEF, RISKY, SILENT, TELLING, Oracle, look_ahead

from planner.belief.particles import Belief

LOPSIDED = np.repeat([[6.0, 0.0, 0.0], [-6.0, 0.0, 0.0]], [4950, 50], axis=0)
LOPSIDED = Belief.of(LOPSIDED)[np.random.default_rng(0).permutation(len(LOPSIDED))]
"""One part in a hundred lies on the other side."""


class Promising(Oracle):
    """As the oracle, but of few particles every squeeze seems to tell where they lie."""

    def __init__(self):
        self.sizes = []

    def squeeze(self, cases, rng):
        self.sizes += [len(belief) for belief, _ in cases]
        tell = np.array([0.0, 0.0, TELLING])
        return super().squeeze([(b, tell if len(b) < 1000 else a) for b, a in cases], rng)


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
    assert look_ahead([TELLING]).choose(Belief.of(spread), np.random.default_rng(0)) == []


def test_what_few_particles_promise_is_asked_of_more():
    ahead = look_ahead([SILENT, TELLING], model=Promising(), confidence=0.995)
    (choice,) = ahead.choose(LOPSIDED, np.random.default_rng(0))
    assert choice.placement[2] == TELLING
    silent = look_ahead([SILENT], model=Promising(), confidence=0.995)
    assert silent.choose(LOPSIDED, np.random.default_rng(0)) == []


def test_the_fewer_parts_come_to_a_belief_the_fewer_particles_it_is_judged_by():
    spent = []
    for share in (1.0, 0.05, 0.001):
        model = Promising()
        ahead = look_ahead([SILENT, TELLING], depth=1, model=model)
        ahead.choose(Belief.joined([BELIEF] * 5), np.random.default_rng(0), share=share)
        spent.append(max(model.sizes))
    assert spent == sorted(spent, reverse=True)
    assert len(set(spent)) == 3
