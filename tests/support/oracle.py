"""Squeezes whose outcome is known, and a look-ahead among them."""

from dataclasses import replace

import numpy as np
import problems

from planner.belief.metric import Metric
from planner.belief.observation import Resolution
from planner.belief.particles import Belief
from planner.belief.partition import Estimate
from planner.belief.transition import Costs, Squeezed
from planner.mechanics.mixture import Mixture
from planner.search.actions import ActionSet
from planner.search.closed_loop import LookAhead
from planner.search.params import Objective, SearchParams
from planner.search.ranking import Ranking

BELIEF = Belief.of(np.repeat([[6.0, 0.0, 0.0], [-6.0, 0.0, 0.0]], 100, axis=0))
AREA = np.array([[-99.0, -99.0], [99.0, 99.0]])
TELLING, SILENT, RISKY = 0.0, 1.0, 2.0
PARAMS = SearchParams()


class Oracle:
    """Moves nothing; at the angle TELLING (and RISKY) the width tells which side the part lies on."""

    def squeeze(self, cases, rng):
        squeezed = []
        for belief, placement in cases:
            telling = placement[2] in (TELLING, RISKY)
            counts = np.where((belief.poses[:, 0] > 0) & telling, 200, 100)
            squeezed.append(Squeezed(replace(belief, reading=counts), float(placement[2] == RISKY), 20.0))
        return squeezed


def look_ahead(angles, depth=2, unstable=0.0, model=None, confidence=0.99, params=PARAMS, proposals=()):
    placements = np.array([[0.0, 0.0, angle] for angle in angles])
    costs = Costs(0.01, 0.0, unstable, 0.4, 85.0, 60.0)
    rule = params.rule(Metric(3.0, 10.0, 2), Estimate(confidence, 1.0 / costs.least), Resolution())
    objective = Objective(rule, costs, params)
    simulator = Mixture((problems.simulator(problems.rectangle()),))
    ranking = Ranking(ActionSet(placements, proposals, AREA), simulator, model or Oracle(), objective)
    return LookAhead(ranking, depth, particles=200)
