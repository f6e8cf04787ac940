"""The generative model: its readings, rewards and filter agree with the rest of the planner."""

import numpy as np
import pytest

from planner.evaluation.trials import Program
from planner.frames import to_hand, to_world
from planner.mechanics.clearance import STANDS_ON, classify_contact
from planner.pomdp import DECLARE, SQUEEZE, Pomdp
from planner.world import ContactWorld
from runtime import table as tables

EVERY_READING = np.arange(228)


@pytest.fixture(scope="module")
def model(job):
    return Pomdp.of_job(job)


def declaring(poses):
    return np.column_stack([poses, np.full(len(poses), DECLARE)])


def test_likelihood_equals_the_frequency_of_simulated_readings(model):
    encoder, n = model.encoder, 200_000
    for width in (0.0, 0.2, 21.0, 33.3, encoder.opening_mm):
        states = np.tile([0.0, 0.0, 0.0, width], (228, 1))
        said = model.likelihood(EVERY_READING, states, np.zeros(4))
        counts = encoder.read(np.full(n, width), np.random.default_rng(1))
        read = np.bincount(counts, minlength=228) / n
        assert said.sum() == pytest.approx(1.0, abs=1e-12)
        assert np.abs(read - said).max() < 5.0 * 0.5 / np.sqrt(n)


def test_sample_cell_with_stated_errors_equals_the_contact_world(model):
    """Fingers that meet at y = 3 mm, and an encoder that reads 1 mm too much, as in the job's world."""
    doubt = {"middle_mm": [2.0, 4.0], "encoder_mm": [0.9, 1.1]}
    off = Pomdp.of_job(model.job.replaced(doubt=doubt))
    states, rng = np.tile([2.0, 3.0, 0.4, 85.0], (400, 1)), np.random.default_rng(3)
    action = np.array([0.0, 0.0, 0.3, SQUEEZE])
    drawn = off.sample(states, action, rng).states
    world = ContactWorld(off.job, 4)
    hand = to_hand(states[:1, :3], action[:3])[0]
    squeezed = [world.squeeze(tuple(hand.tolist()))[:2] for _ in range(400)]
    poses = to_world(np.array([pose for pose, _ in squeezed]), action[:3])
    widths = np.array([width for _, width in squeezed])
    spread = np.array([*poses.std(axis=0), widths.std()]) + 1e-3
    apart = drawn.mean(axis=0) - [*poses.mean(axis=0), widths.mean()]
    assert np.all(np.abs(apart) < 5.0 * spread * np.sqrt(2.0 / 400))
    plain = model.sample(states, action, rng).states
    assert abs(drawn[:, 3].mean() - plain[:, 3].mean()) > 0.5


def test_sample_finger_above_the_part_ends_the_episode(model):
    rng = np.random.default_rng(2)
    states = model.initial(3000, rng) * [2.5, 2.5, 1.0, 1.0]
    placements = model.actions[rng.integers(model.placements, size=len(states))]
    sampled = model.sample(states, placements, rng)
    hand = to_hand(states[:, :3], placements[:, :3].T)
    below = classify_contact(model.simulator.outline, model.simulator.jaws, hand) == STANDS_ON
    assert below.any()
    assert np.array_equal(sampled.ended, below)
    assert sampled.states[below, :3] == pytest.approx(states[below, :3])
    assert (sampled.rewards == -1.0).all()


def test_sample_declared_pose_is_rewarded_within_goal_and_symmetry(model):
    rng = np.random.default_rng(3)
    states = model.initial(500, rng)
    off = rng.normal(size=(500, 3)) * [2.0, 2.0, 0.2]
    sampled = model.sample(states, declaring(states[:, :3] + off + [0.0, 0.0, np.pi]), rng)
    length = np.hypot(off[:, 0], off[:, 1]) + model.metric.rho_mm * np.abs(off[:, 2])
    assert np.array_equal(sampled.rewards, np.where(length < 3.0, 100.0, 0.0))
    assert sampled.ended.all()
    assert np.array_equal(sampled.states, states)


def test_pomdp_planned_table_reaches_its_predicted_figures(model, table):
    program, rng, n = Program.of(table), np.random.default_rng(4), 3000
    states, node = model.initial(n, rng), np.zeros(n, np.int64)
    squeezes, right = 0, 0.0
    while len(states):
        squeeze = np.column_stack([program.placement[node], np.zeros(len(node))])
        sampled = model.sample(states, squeeze, rng)
        squeezes += len(states)
        reading = 2 * sampled.observations + (sampled.states[:, 3] > 0.0)
        node = program.target[program.segment(node, reading)]
        leaf = (node < 0) & (node > -len(table.leaves) - 1)
        poses = np.reshape([tables.predicted_pose(table.leaves[~k]) for k in node[leaf]], (-1, 3))
        rewards = model.sample(sampled.states[leaf], declaring(poses), rng).rewards
        right += rewards.sum() / model.success
        states, node = sampled.states[node >= 0], node[node >= 0]
    assert right / n > table.predicted.success_ppm / 1e6 - 0.005
    assert squeezes / n == pytest.approx(table.predicted.mean_squeezes_ppm / 1e6, abs=0.06)


def test_pomdp_unexplained_reading_or_invalid_state_raises(model):
    rng = np.random.default_rng(7)
    with pytest.raises(ValueError, match="none of 50 states explains the reading 17"):
        model.updated(model.initial(50, rng), model.actions[0], 17, rng)
    with pytest.raises(ValueError, match=r"pass \(n, 4\)"):
        model.sample(np.zeros((2, 3)), model.actions[0][:3], rng)
    with pytest.raises(ValueError, match="pass finite numbers"):
        model.sample(np.full((2, 4), np.nan), model.actions[0], rng)


def test_updated_belief_mode_is_right_as_often_as_its_ratio(model):
    rng = np.random.default_rng(5)
    said, right = [], []
    for _ in range(40):
        state, belief = model.initial(1, rng), model.initial(400, rng)
        for placement in rng.permutation(model.placements)[:3]:
            sampled = model.sample(state, model.actions[placement], rng)
            count = int(sampled.observations[0])
            belief = model.updated(belief, model.actions[placement], count, rng)
            state = sampled.states
        mode = model.metric.mode(belief[:, :3])
        said.append(mode.ratio)
        right.append(model.metric.reached(state[0, :3], mode.pose))
    spread = np.sqrt(np.sum(np.multiply(said, 1.0 - np.array(said)))) + 1.0
    assert abs(np.sum(right) - np.sum(said)) < 3.0 * spread
