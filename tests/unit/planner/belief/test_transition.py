"""The outcomes of a squeeze of a belief."""

import numpy as np
import problems

from planner.belief.metric import Metric
from planner.belief.observation import Encoder, encoder_of, resolution_of
from planner.belief.particles import Belief, initial
from planner.belief.partition import Rule
from planner.belief.stopping import StoppingRule
from planner.belief.transition import Outcomes, Simulation
from planner.mechanics.simulator import RollOut
from planner.mechanics.traits import FRESH, as_planned


def test_without_gaps_marked_branch_is_cut_at_its_gaps():
    reading = np.array([40, 41, 60, 61, 80, 120, 140])
    belief = Belief(np.zeros((7, 3)), as_planned(7), reading)
    outcomes = Outcomes([belief[5:], belief[:5]], 30.0)
    assert len(outcomes.without_gaps(np.array([True, True]), 20).beliefs) == 2
    cut = outcomes.without_gaps(np.array([False, True]), 10)
    assert [set(piece.reading) for piece in cut.beliefs] == [{120, 140}, {80}, {60, 61}, {40, 41}]
    assert cut.clusters.low.tolist() == [120, 80, 60, 40]
    assert cut.clusters.high.tolist() == [140, 80, 61, 41]
    assert np.isclose(cut.probability.sum(), 1.0)


def test_squeeze_uses_and_keeps_the_friction_of_each_particle(job):
    """Nearly frictionless fingers rarely hold a part by its diagonal; those of the job often do."""
    simulator = problems.simulator(problems.rectangle())
    model, rng = Simulation(simulator, encoder_of(job)), np.random.default_rng(4)
    poses = initial(job, 1000, rng)
    belief = Belief.of(poses)
    belief.traits["friction"][::2] = 0.01
    (squeezed,) = model.squeeze([(belief, np.zeros(3))], rng)
    after = squeezed.belief.traits["friction"]
    assert (after == FRESH).sum() == 500
    assert set(after[after != FRESH].tolist()) == {0.01}
    width = encoder_of(job).width_mm(squeezed.belief.reading)
    diagonal = (width > 33.0) & (width < 40.0)
    slippery = after != FRESH
    assert np.mean(diagonal[~slippery]) > 0.02
    assert np.mean(diagonal[slippery]) < 0.2 * np.mean(diagonal[~slippery])


def test_outcomes_empty_hand_is_separate_from_a_thin_part():
    """Their outcomes are separate, although the readings 117 and 114 are near enough to share a cluster."""
    encoder = Encoder(85.0, 117, 0.01)
    width = np.repeat([0.0, 2.0], 50)

    class Emptied:
        """A simulator in which half of the parts slip out of the jaws."""

        def squeeze(self, poses, rng, traits):
            return RollOut(poses, width, np.zeros(100, np.int64), np.zeros(100, np.int64))

    case = (Belief.of(np.zeros((100, 3))), np.zeros(3))
    (squeezed,) = Simulation(Emptied(), encoder).squeeze([case], np.random.default_rng(0))
    rule = Rule(Metric(1.0, 5.0, 1), StoppingRule(0.99), resolution_of(encoder))
    outcomes = Outcomes.of(squeezed, rule)
    assert outcomes.clusters.size.tolist() == [50, 50]
