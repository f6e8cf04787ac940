"""The Gymnasium environment, single or vectorised, keeps Gymnasium's rules, and a seed repeats an episode."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rectangle import JOB_PATH

import planner.gym

OPEN = 0  # reading of open jaws


@pytest.fixture(scope="module")
def alone():
    return gymnasium.make(planner.gym.NAME)


@pytest.fixture(scope="module")
def many():
    return gymnasium.make_vec(planner.gym.NAME, num_envs=300)


@pytest.fixture(scope="module")
def drawn():
    return gymnasium.make(planner.gym.NAME, render_mode="rgb_array")


def episode(env, seed, steps=5):
    """Starts an episode with a seed; returns the first observation and the results of random steps."""
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        seen.append(env.step(rng.integers(4, size=getattr(env, "num_envs", None)))[:4])
    return seen


@pytest.mark.parametrize(
    "arguments",
    [{}, {"actions": "box", "job": str(JOB_PATH)}, {"render_mode": "rgb_array"}],
    ids=str,
)
def test_squeeze_localize_passes_the_gymnasium_checker(arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(planner.gym.NAME, **arguments).unwrapped)


def test_render_after_each_action_draws_another_picture(drawn):
    drawn.reset(seed=3)
    frames = [drawn.render()]
    for action in (0, 2, drawn.unwrapped.model.placements):
        drawn.step(action)
        frames.append(drawn.render())
    assert {(frame.shape, frame.dtype.name) for frame in frames} == {((480, 480, 3), "uint8")}
    assert len({frame.tobytes() for frame in frames}) == len(frames)
    assert np.array_equal(frames[-1], drawn.render())


def test_reset_same_seed_repeats_the_episode(alone, many):
    assert episode(alone, 4) == episode(alone, 4)
    assert episode(alone, 4) != episode(alone, 5)
    for first, second in zip(episode(many, 4), episode(many, 4), strict=True):
        assert np.array_equal(first, second)


def test_squeeze_localize_vector_of_one_equals_the_single_one(alone):
    batch = gymnasium.make_vec(planner.gym.NAME, num_envs=1)
    alone.reset(seed=8)
    batch.reset(seed=8)
    for action in (1, 0, 3, 40):
        one, several = alone.step(action), batch.step(np.array([action]))
        assert [one[k] for k in range(4)] == [several[k][0] for k in range(4)]
        assert np.array_equal(one[4]["pose"], several[4]["pose"][0])
    assert one[2]


def test_step_beyond_max_depth_truncates_the_episode(alone):
    most = alone.unwrapped.model.job.search.max_depth
    alone.reset(seed=2)
    ends = [alone.step(0)[2:4] for _ in range(most + 1)]
    assert ends == [(False, False)] * most + [(False, True)]


def test_vector_step_after_an_end_begins_a_new_episode(many):
    many.reset(seed=3)
    actions = np.zeros(300, np.int64)
    actions[:100] = many.unwrapped.model.placements  # declares the first candidate
    ended = many.step(actions)[2]
    assert np.array_equal(ended, actions > 0)
    before = many.step(actions)
    assert (before[0][:100] == OPEN).all()
    assert not before[1][:100].any()
    assert not before[2][:100].any()
    assert (np.hypot(*before[4]["pose"][:100, :2].T) <= 12.75).all()
    assert (many.step(actions)[2] == (actions > 0)).all()


@pytest.mark.parametrize("action", [-1, 68])
def test_step_unknown_action_raises(alone, action):
    alone.reset(seed=1)
    with pytest.raises(ValueError, match="there are 0 to 67"):
        alone.unwrapped.step(action)
