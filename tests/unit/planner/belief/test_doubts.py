"""What a job doubts becomes traits that particles keep."""

from pathlib import Path

import numpy as np
import pytest

from planner.belief.doubts import ROUGH, SLIPPERY, believed, pushed_of
from planner.belief.observation import encoder_of
from planner.belief.particles import initial, replenish, subsample
from planner.belief.transition import Simulation, placing_of
from planner.evaluation.disturbance import Disturbance, with_doubts
from planner.evaluation.trials import Program, run
from planner.frames import to_hand, to_world
from planner.job import model as job_file
from planner.mechanics.simulator import Simulator
from planner.mechanics.traits import FRESH, as_planned, ordinary
from planner.part.outline import min_width
from planner.world import ContactWorld
from runtime.table import load

TREES = Path(__file__).parents[4] / "trees"
LOW, HIGH = 0.4, 0.6
DOUBTS = {
    "finger_share": [-0.1, 0.1],
    "middle_mm": [0.2, 0.4],
    "encoder_mm": [-1, 1],
    "encoder_gain": [0, 0.02],
    "pressure": "any",
    "least_dof": 10,
    "placement_mm": 0.2,
    "placement_deg": 0.3,
}


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "rectangle" / "job.toml").replaced(doubt={"chance": 0})


@pytest.fixture(scope="module")
def doubting(job):
    return job.replaced(doubt={**DOUBTS, "chance": 0.7}, part={"tolerance_mm": 0.3})


def squeezed(job, belief, rng, placement=(1.0, -2.0, 0.3)):
    model = Simulation(Simulator.of_job(job, 1), encoder_of(job), placing_of(job))
    return model.squeeze([(belief, np.array(placement))], rng)[0].belief


def test_stated_pushes_doubt_all_that_they_feel_each_for_itself(doubting):
    """Rim, area, its middle and feet alike; nothing of jaws and encoder."""
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


def test_stated_pushes_of_a_certain_job_are_as_planned(job):
    traits = pushed_of(
        job.replaced(friction={"doubt": 0.0}, doubt={"pressure": "stated"}),
        50,
        np.random.default_rng(2),
    )
    assert ordinary(traits).all()


def test_a_share_of_the_particles_doubts_the_stated_friction_half_of_it_either_way(job):
    friction = believed(job, 40_000, np.random.default_rng(1)).traits["friction"]
    ours = friction[friction != FRESH]
    assert abs(len(ours) / 40_000 - job.friction.doubt) < 4.0 * np.sqrt(0.25 / 40_000)
    slippery, rough = ours[ours < LOW], ours[ours > HIGH]
    assert len(slippery) + len(rough) == len(ours)
    assert abs(len(slippery) / len(ours) - 0.5) < 4.0 * np.sqrt(0.25 / len(ours))
    assert SLIPPERY * LOW <= slippery.min() < 1.02 * SLIPPERY * LOW
    assert 0.98 * ROUGH * HIGH < rough.max() <= ROUGH * HIGH


def test_poses_are_those_of_a_belief_without_doubt(job, doubting):
    poses = initial(job, 100, np.random.default_rng(2))
    assert np.array_equal(believed(doubting, 100, np.random.default_rng(2)).poses, poses)
    certain = job.replaced(friction={"doubt": 0})
    assert ordinary(believed(certain, 100, np.random.default_rng(2)).traits).all()


def test_one_thing_at_most_is_off_within_its_interval_and_the_others_are_at_the_middle(doubting):
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


def test_traits_are_kept_by_thinning_repeating_and_squeezing(doubting):
    belief = believed(doubting, 300, np.random.default_rng(3))
    ours = {pose.tobytes(): row for pose, row in zip(belief.poses, belief.traits, strict=True)}
    for other, n in ((subsample(belief, 70), 70), (replenish(belief, 500), 500)):
        assert len(other) == len(other.traits) == n
        for pose, row in zip(other.poses, other.traits, strict=True):
            assert ours[pose.tobytes()].tobytes() == row.tobytes()
    after = squeezed(doubting, belief, np.random.default_rng(4))
    assert after.traits.tobytes() == belief.traits.tobytes()


def test_an_encoder_that_is_off_shifts_readings_and_nothing_else(job):
    belief = believed(job.replaced(friction={"doubt": 0}), 2000, np.random.default_rng(5))
    plain = squeezed(job, belief, np.random.default_rng(6))
    belief.traits["encoder_mm"] = 3.0 * encoder_of(job).mm_per_step
    off = squeezed(job, belief, np.random.default_rng(6))
    assert np.array_equal(off.poses, plain.poses)
    held = plain.reading < encoder_of(job).steps - 5
    assert np.array_equal(plain.reading[held] - off.reading[held], np.full(held.sum(), 3))


def test_a_displaced_hand_is_the_same_as_another_placement(job):
    belief = believed(job.replaced(friction={"doubt": 0}), 500, np.random.default_rng(7))
    hand = np.array([1.0, -2.0, 0.3])
    moved = to_world(np.array([0.0, 2.5, 0.0]), hand)
    there = squeezed(job, belief, np.random.default_rng(8), moved)
    belief.traits["across_mm"] = 2.5
    assert np.allclose(
        squeezed(job, belief, np.random.default_rng(8), hand).poses, there.poses, atol=1e-9
    )


def test_a_squeeze_between_uneven_fingers_is_one_with_another_gripper(job):
    """The rows that have a share of their own end as in a job whose gripper has that share."""
    n = 400
    poses = to_hand(initial(job, n, np.random.default_rng(9)), np.zeros(3))
    part = Simulator.of_job(job, 1)
    parameters = part.sample(n, np.random.default_rng(10))
    half = parameters._replace(share=np.where(np.arange(n) % 2, 0.4, 0.5))
    other = Simulator.of_job(job.replaced(gripper={"upper_finger_share": 0.4}), 1)
    mixed, even = part.roll_out(poses, half), part.roll_out(poses, parameters)
    uneven = other.roll_out(poses, parameters._replace(share=None))
    assert np.array_equal(mixed.poses[1::2], uneven.poses[1::2])
    assert np.array_equal(mixed.poses[::2], even.poses[::2])


def test_parts_in_a_cell_with_doubts_have_traits_and_others_none(job, doubting):
    rng = np.random.default_rng(11)
    assert not ordinary(with_doubts(doubting).traits(doubting, 100, rng)).all()
    assert np.array_equal(
        Disturbance(0.5).traits(doubting, 10, rng)["encoder_mm"], np.full(10, 0.5)
    )
    assert ordinary(Disturbance(0.5, across_mm=1.0).traits(doubting, 10, rng)).all()
    assert ordinary(as_planned(5)).all()


def test_what_opening_jaws_do_to_a_part_is_of_its_own_size_for_each_and_drawn_anew_in_each_squeeze(
    job,
):
    n, doubt = 20_000, {"chance": 1.0, "release_mm": 0.8, "release_deg": 2.0}
    for key in ("finger_share", "middle_mm", "encoder_mm"):
        doubt[key] = [0, 0]
    slack = job.replaced(doubt=doubt, friction={"doubt": 0}, part={"tolerance_mm": 0})
    belief = believed(slack, n, np.random.default_rng(12))
    size = belief.traits["release"]
    assert 0.79 < size[:, 0].max() <= 0.8
    assert np.allclose(size[:, 1] / np.radians(2.0), size[:, 0] / 0.8)
    assert not ordinary(belief.traits).any()
    simulator = Simulator.of_job(slack, 1)
    rng, again = np.random.default_rng(13), np.random.default_rng(13)
    first, second = (simulator.sample(n, rng, belief.traits).release for _ in range(2))
    for release in (first, second):
        scaled = release / size[:, [0, 0, 1]]
        assert np.allclose(scaled.std(axis=0), 1.0, atol=0.03)
    assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < 0.03
    plain = simulator.sample(
        n, again
    )  # the rest is what it would be, and without the doubt so is this
    assert not plain.release.any()


def test_an_arm_that_is_off_lies_in_its_own_frame_as_the_part_does(job):
    """A squeeze by an arm that is off, seen in its frame, is that of a part that lies as far off instead."""
    off = np.array([0.9, -0.7, 0.0])
    belief = believed(job.replaced(friction={"doubt": 0}), 400, np.random.default_rng(14))
    hand = np.array([1.0, -2.0, 0.3])
    seen = squeezed(job, belief, np.random.default_rng(15), hand + off)
    belief.poses[:] -= off
    there = squeezed(job, belief, np.random.default_rng(15), hand)
    assert np.allclose(seen.poses - off, there.poses, atol=1e-9)
    assert np.array_equal(seen.reading, there.reading)


def test_parts_lie_off_as_far_as_the_arm_may_be_in_beliefs_and_in_trials(job):
    doubt = {"chance": 1.0, "arm_mm": 1.5, "arm_deg": 2.0}
    for key in ("finger_share", "middle_mm", "encoder_mm"):
        doubt[key] = [0, 0]
    doubting = job.replaced(
        doubt=doubt,
        part={"tolerance_mm": 0},
        uncertainty={"radius_mm": 0, "orientation_halfwidth_deg": 0},
    )
    belief = believed(doubting, 5000, np.random.default_rng(16))
    table = load(TREES / "rectangle" / "rectangle.msgpack").table
    world = ContactWorld.of_simulator(Simulator.of_job(doubting, 1), [3])
    tried = run(
        Program.of(table), doubting, world, 500, np.random.default_rng(17), with_doubts(doubting)
    )
    for poses in (belief.poses, tried.initial):
        away, turned = np.hypot(poses[:, 0], poses[:, 1]), np.degrees(poses[:, 2])
        assert 1.45 < away.max() <= 1.5
        assert 1.9 < turned.max() <= 2.0
        assert -2.0 <= turned.min() < -1.9
        assert abs(poses[:, :2].mean()) < 0.15
