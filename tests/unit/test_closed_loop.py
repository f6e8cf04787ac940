"""The look-ahead, on squeezes whose outcome is known."""

import numpy as np
import problems

from planner.goal import Metric
from planner.models.partition import partition
from planner.search.actions import ActionSet
from planner.search.closed_loop import LookAhead
from planner.search.costs import Costs
from planner.search.outcomes import Outcomes

BELIEF = np.repeat([[6.0, 0.0, 0.0], [-6.0, 0.0, 0.0]], 100, axis=0)
AREA = np.array([[-99.0, -99.0], [99.0, 99.0]])
TELLING, SILENT, RISKY = 0.0, 1.0, 2.0


class Oracle:
    """Moves nothing; at the angle TELLING (and RISKY) the width tells which side the part lies on."""

    def squeeze(self, cases, rng):
        outcomes = []
        for belief, placement in cases:
            telling = placement[2] in (TELLING, RISKY)
            counts = np.where((belief[:, 0] > 0) & telling, 200, 100)
            clusters = partition(counts)
            label = clusters.label[counts]
            beliefs = [belief[label == k] for k in range(len(clusters.mean))]
            outcomes.append(Outcomes(clusters, beliefs, float(placement[2] == RISKY), 20.0))
        return outcomes


def look_ahead(angles, depth=2, unstable=0.0):
    placements = np.array([[0.0, 0.0, angle] for angle in angles])
    return LookAhead(
        actions=ActionSet(placements, None, AREA),
        simulator=problems.simulator(problems.rectangle()),
        model=Oracle(),
        metric=Metric(3.0, 10.0, 2),
        confidence=0.99,
        depth=depth,
        costs=Costs(0.01, 0.0, unstable, 0.4, 85.0, 60.0),
        particles=200,
    )


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
