"""The latent parameters in a job give each particle its traits, and the particle keeps them."""

import numpy as np
import pytest

from planner.belief.doubts import ROUGH, SLIPPERY, believed, pushed_of
from planner.belief.observation import encoder_of
from planner.belief.particles import initial
from planner.belief.transition import Simulation
from planner.frames import to_hand
from planner.mechanics.simulator import Simulator
from planner.mechanics.traits import FRESH, as_planned
from planner.part.outline import min_width

LOW, HIGH = 0.4, 0.6
DOUBTS = {
    "finger_share": [-0.1, 0.1],
    "middle_mm": [0.2, 0.4],
    "encoder_mm": [-1, 1],
    "encoder_gain": [0, 0.02],
    "pressure": "any",
    "least_dof": 10,
}


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(doubt={"chance": 0})


@pytest.fixture(scope="module")
def doubting(job):
    return job.replaced(doubt={**DOUBTS, "chance": 0.7}, part={"tolerance_mm": 0.3})


def squeezed(job, belief, rng, placement=(1.0, -2.0, 0.3)):
    model = Simulation(Simulator.of_job(job, 1), encoder_of(job))
    return model.squeeze([(belief, np.array(placement))], rng)[0].belief


def test_pushed_of_varies_surface_friction_and_dof_only(doubting):
    """The four kinds of pressure are equally likely; the traits of jaws and encoder stay nominal."""
    n = 30_000
    traits = pushed_of(doubting, n, np.random.default_rng(2))
    ways = np.bincount(np.minimum(traits["surface"], 3), minlength=4) / n
    assert ways == pytest.approx(np.full(4, 1 / 4), abs=0.01)
    assert traits["surface"].max() == len(Simulator.of_job(doubting, 1).others)
    assert (traits["dof"] == doubting.doubt.least_dof).all()
    assert np.mean(traits["friction"] != FRESH) == pytest.approx(0.3, abs=0.02)
    felt = as_planned(n)
    for name in ("surface", "dof", "friction"):
        felt[name] = traits[name]
    assert np.array_equal(felt, traits)


def test_believed_friction_is_off_for_a_share_half_of_it_each_way(job):
    friction = believed(job, 40_000, np.random.default_rng(1)).traits["friction"]
    ours = friction[friction != FRESH]
    assert abs(len(ours) / 40_000 - job.friction.doubt) < 4.0 * np.sqrt(0.25 / 40_000)
    slippery, rough = ours[ours < LOW], ours[ours > HIGH]
    assert len(slippery) + len(rough) == len(ours)
    assert abs(len(slippery) / len(ours) - 0.5) < 4.0 * np.sqrt(0.25 / len(ours))
    assert SLIPPERY * LOW <= slippery.min() < 1.02 * SLIPPERY * LOW
    assert 0.98 * ROUGH * HIGH < rough.max() <= ROUGH * HIGH


def test_believed_particle_has_at_most_one_parameter_off(doubting):
    n = 40_000
    traits = believed(doubting, n, np.random.default_rng(3)).traits
    closing = doubting.gripper.opening_mm - min_width(doubting.part.outline_mm)
    values = {
        "finger_share": traits["share"],
        "middle_mm": traits["across_mm"] - closing * traits["share"],
        "encoder_mm": traits["encoder_mm"],
        "encoder_gain": traits["gain"],
    }
    off = [traits["surface"] > 0, traits["dof"] > 0, traits["deviation"].any(axis=1)]
    for name, result in values.items():
        low, high = DOUBTS[name]
        assert low - 1e-9 <= result.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < result.max() <= high + 1e-9
        off.append(~np.isclose(result, 0.5 * (low + high), atol=1e-9))
    assert np.max(np.sum(off, axis=0)) == 1
    share = doubting.doubt.chance / len(off)
    assert np.allclose(np.mean(off, axis=1), share, atol=5.0 * np.sqrt(share / n))
    assert set(np.unique(traits["surface"])) == set(
        range(1 + len(Simulator.of_job(doubting, 1).others))
    )
    assert traits["dof"][traits["dof"] > 0].min() >= 10


def test_squeeze_keeps_traits(doubting):
    belief = believed(doubting, 300, np.random.default_rng(3))
    after = squeezed(doubting, belief, np.random.default_rng(4))
    assert after.traits.tobytes() == belief.traits.tobytes()


def test_squeeze_encoder_offset_shifts_readings_only(job):
    belief = believed(job.replaced(friction={"doubt": 0}), 500, np.random.default_rng(5))
    plain = squeezed(job, belief, np.random.default_rng(6))
    belief.traits["encoder_mm"] = 3.0 * encoder_of(job).mm_per_step
    off = squeezed(job, belief, np.random.default_rng(6))
    assert np.array_equal(off.poses, plain.poses)
    held = plain.reading < encoder_of(job).steps - 5
    assert np.array_equal(plain.reading[held] - off.reading[held], np.full(held.sum(), 3))


def test_roll_out_finger_share_equals_gripper_with_that_share(job):
    """A part with a finger share of 0.4 ends as in a gripper of that share; other parts are not affected."""
    n = 100
    poses = to_hand(initial(job, n, np.random.default_rng(9)), np.zeros(3))
    part = Simulator.of_job(job, 1)
    parameters = part.sample(n, np.random.default_rng(10))
    half = parameters._replace(share=np.where(np.arange(n) % 2, 0.4, 0.5))
    other = Simulator.of_job(job.replaced(gripper={"upper_finger_share": 0.4}), 1)
    mixed, even = part.roll_out(poses, half), part.roll_out(poses, parameters)
    uneven = other.roll_out(poses, parameters._replace(share=np.full(n, 0.4)))
    assert np.array_equal(mixed.poses[1::2], uneven.poses[1::2])
    assert np.array_equal(mixed.poses[::2], even.poses[::2])
