"""The look-ahead, on squeezes whose outcome is known."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import BELIEF, PARAMS, RISKY, SILENT, TELLING, Oracle, look_ahead

from planner.belief.particles import Belief
from planner.search.proposals import Proposals

HINT = 3.0
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


@pytest.mark.parametrize("share", [1.0, 0.0001])
def test_the_more_parts_are_at_stake_the_more_hands_all_about_them_are_tried(share):
    silent = np.array([[0.0, 0.0, SILENT]])
    scattered = np.repeat([[0.0, 0.0, SILENT], [0.0, 0.0, TELLING]], [40, 1], axis=0)
    narrow = look_ahead([SILENT], proposals=(Proposals(silent),))
    wide = look_ahead([SILENT], proposals=(Proposals(silent, scattered),))
    assert narrow.choose(BELIEF, np.random.default_rng(0), share=share) == []
    found = wide.choose(BELIEF, np.random.default_rng(0), share=share)
    assert [choice.placement[2] for choice in found] == ([TELLING] if share == 1.0 else [])


class Hinting(Oracle):
    """As the oracle, but at the angle HINT the width tells of half the parts on one side where they lie."""

    def squeeze(self, cases, rng):
        squeezed = super().squeeze(cases, rng)
        for (_, placement), each in zip(cases, squeezed, strict=True):
            told = (each.belief.poses[:, 0] > 0) & (rng.random(len(each.belief)) < 0.5)
            each.belief.reading[told & (placement[2] == HINT)] = 200
        return squeezed


@pytest.mark.parametrize(("hard", "best"), [(0.0, TELLING), (9.0, HINT)])
def test_more_hands_are_tried_where_the_best_of_few_leaves_much_to_do(hard, best):
    scattered = np.repeat([[0.0, 0.0, SILENT], [0.0, 0.0, TELLING]], [100, 1], axis=0)
    proposals = (Proposals(scattered[:1], scattered),)
    ahead = look_ahead([HINT], model=Hinting(), proposals=proposals, params=replace(PARAMS, hard=hard))
    found = ahead.choose(BELIEF, np.random.default_rng(0), share=0.01)
    assert found[0].placement[2] == best


def test_after_squeezes_in_vain_the_lesser_efforts_are_left_out():
    sizes = []
    for vain in range(3):
        model = Promising()
        ahead = look_ahead([SILENT], depth=1, model=model, confidence=0.995)
        assert ahead.choose(LOPSIDED, np.random.default_rng(0), vain=vain) == []
        sizes.append(model.sizes)
    few, deeper, many = sizes
    assert few[-len(deeper) :] == deeper
    assert deeper[-len(many) :] == many
    assert len(few) > len(deeper) > len(many) > 0
    assert min(deeper) == 200 < min(many)


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


def test_of_many_options_few_are_squeezed_by_all_particles_and_the_telling_one_is_among_them():
    model = Promising()
    ranking = look_ahead([SILENT, TELLING], model=model).ranking
    belief = Belief.joined([LOPSIDED] * 2)
    placements = np.array([[0.0, 0.0, angle] for angle in [*np.linspace(0.1, 0.9, 30), TELLING]])
    (options,) = ranking.squeeze([belief], [placements], np.random.default_rng(0))
    assert TELLING in options.placements[:, 2]
    assert len(options.placements) == ranking.objective.params.finalists
    assert sum(model.sizes) < 0.4 * len(placements) * len(belief)
    assert all(len(squeezed.belief) == len(belief) for squeezed in options.squeezed)


def test_few_options_are_squeezed_once_by_all_particles():
    model = Promising()
    ranking = look_ahead([SILENT, TELLING], model=model).ranking
    placements = np.array([[0.0, 0.0, SILENT], [0.0, 0.0, TELLING]])
    ranking.squeeze([BELIEF], [placements], np.random.default_rng(0))
    assert model.sizes == [len(BELIEF)] * 2
