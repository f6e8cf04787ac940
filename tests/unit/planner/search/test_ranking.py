"""The ranking of options by its kernel, against the same from branches, one belief at a time."""

from pathlib import Path

import numpy as np
import pytest

from planner.belief.observation import encoder_of
from planner.belief.particles import Belief, initial
from planner.belief.transition import Outcomes, Simulation
from planner.compile import objective_of
from planner.job import model as job_file
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import as_planned
from planner.search.actions import actions_of
from planner.search.ranking import Ranking

GUSSET = Path(__file__).parents[4] / "trees" / "gusset" / "job.toml"
FACES = {"part": {"faces": "either"}}
SORTED = {"goal": {"identify": False}}
PRICES = {"search": {"stability_cost": 0.02, "second_cost": 0.01}}


@pytest.mark.parametrize("changes", [{}, PRICES, FACES, FACES | SORTED], ids=str)
def test_options_are_judged_as_their_branches_say(changes):
    job = job_file.load(GUSSET, changes)
    rng, objective = np.random.default_rng(5), objective_of(job)
    mixture = Mixture.of_job(job, 1)
    model = Simulation(mixture, encoder_of(job))
    ranking = Ranking(actions_of(job), mixture, model, objective)
    traits = as_planned(120)
    traits["hypothesis"] = np.arange(120) % len(mixture.simulators)
    belief = Belief.of(initial(job, 120, rng), traits=traits)
    (options,) = ranking.squeeze([belief], [ranking.candidates(belief, belief)[:20]], rng)
    assert 1 < len(options.placements) < 20
    metric, params = objective.metric, objective.params
    for k, squeezed in enumerate(options.squeezed):
        outcomes = Outcomes.of(squeezed, objective.rule)
        size = outcomes.clusters.size
        assert len(size) == options.branches[k]
        assert size.sum() == len(belief)
        shares = metric.shares([child.states for child in outcomes.beliefs], metric.modes + 1)
        first, further = shares[:, : metric.modes].sum(axis=1), shares[:, metric.modes]
        left = outcomes.probability @ objective.rule.estimate.squeezes(first * size, size)
        cost = objective.costs.of(outcomes.unstable, outcomes.width_mm)
        assert options.cost[k] == pytest.approx(cost)
        assert options.ratio[k] == pytest.approx(outcomes.probability @ first)
        assert options.cost_to_go[k] == pytest.approx(cost + left)
        rank = cost + left - params.second_mode * (outcomes.probability @ further)
        assert options.rank[k] == pytest.approx(rank)
