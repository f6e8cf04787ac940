"""Trials of a decision table equal a slow reference version, and a part under a finger ends in a crash.

A turned decision table does with turned parts what the original does with the original parts.
"""

import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from sample_tables import random_table

from planner.belief.observation import encoder_of
from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import CRASHED, NOWHERE, REJECTED
from planner.evaluation.times import seconds_of
from planner.evaluation.trials import placement_of
from planner.frames import to_hand, to_world
from planner.mechanics.squeeze import GRASPED, SLIPPED, STATUS_NAMES
from runtime.shell.errors import UsageError
from runtime.table import (
    HELD_UM,
    REJECT,
    Place,
    Schedule,
    Squeezed,
    decision_map,
    turned,
    turned_pose,
)


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(gripper={"noise_mm": 0})


class Wrung:
    """A world without physics: formulas give the final pose, the width and whether the part is held."""

    def __init__(self):
        self.seen = []

    def squeeze(self, pose):
        self.seen.append(pose)
        x, y, theta = pose
        width = max(0.0, 26.0 + 12.0 * math.sin(3.0 * theta + 0.2 * x + 0.1 * y))
        status = STATUS_NAMES[GRASPED if math.cos(7.0 * theta) > -0.5 else SLIPPED]
        return (0.8 * x, -0.5 * y, theta + 0.3), width, status


def spread_table(nodes=12, seed=3):
    """A random table whose branches cover most widths; after some squeezes the hand drags the part."""
    random = Random(seed)
    table = random_table(seed, nodes)
    rows = []
    for node in table.nodes:
        cuts = np.linspace(16_000, 36_000, len(node.branches) + 1).round(-2).astype(int).tolist()
        branches = tuple(
            branch._replace(low_um=low, expected_um=(low + high) // 2, high_um=high)
            for branch, low, high in zip(node.branches, cuts, cuts[1:], strict=False)
        )
        release = random.choice([None, Place(random.randint(-9_000, 9_000), 1_000)])
        rows.append(node._replace(branches=branches, release=release))
    return replace(table, nodes=tuple(rows))


def walk(table, job, start):
    """Slow reference version of a trial: leads one part from node to node, as the runtime does.

    Returns:
        The leaf or `REJECTED`, the path, the final pose, and the readings.
    """
    encoder = encoder_of(job)
    rng, world = np.random.default_rng(0), Wrung()
    pose, target, path, readings = start, 0, [], []
    while target >= 0:
        node = table.nodes[target]
        place = placement_of(node.squeeze)
        final, width, status = world.squeeze(tuple(to_hand(pose, place)))
        count = int(encoder.read(np.array([width]), rng)[0])
        path.append((target, count))
        pose = to_world(np.array(final), place)
        width_um = int(encoder.width_um(np.array(count)))
        number = decision_map(node, table.gripper).either.at(width_um)
        readings.append(Squeezed(path[-1][0], width_um / 1e3, number))
        if number == REJECT:
            return REJECTED, path, pose, readings
        branch = node.branches[number]
        if node.release is not None and branch.expected_um >= HELD_UM:
            release = np.array(node.release) / 1e3
            if status == STATUS_NAMES[GRASPED]:
                pose = pose + np.array([*(release - place[:2]), 0.0])
        target = branch.target
    return ~target, path, pose, readings


def test_evaluate_equals_a_walk_of_one_part_at_a_time(job):
    table = spread_table()
    assert any(node.release is not None for node in table.nodes)
    evaluation = evaluate(table, job, Wrung(), 300, seed=5)
    outcomes, schedule = set(), Schedule.of(table, None)
    seconds = seconds_of(table, evaluation.path, evaluation.reading, evaluation.branch)
    *_, before = walk(table, job, evaluation.initial[-1])
    for trial in range(300):
        leaf, path, pose, readings = walk(table, job, evaluation.initial[trial])
        outcomes.add(leaf)
        assert evaluation.leaf[trial] == leaf
        assert evaluation.squeezes[trial] == len(path)
        assert (
            list(zip(evaluation.path[trial], evaluation.steps[trial], strict=True))[: len(path)]
            == path
        )
        assert np.all(evaluation.path[trial, len(path) :] == NOWHERE)
        assert np.allclose(evaluation.poses[trial], pose, atol=1e-9)
        _, stands, _ = schedule.squeeze(before[-1], None, None, first=True)
        expected = sum(phases.total_s for phases in schedule.part(readings, stands))
        assert seconds[trial] == pytest.approx(expected)
        before = readings
    assert REJECTED in outcomes
    assert len(outcomes) > 5


@pytest.mark.parametrize("crashed", [0, 7, 19])
def test_seconds_of_part_never_squeezed_are_zero_and_change_no_other(job, crashed):
    run = evaluate(spread_table(), job, Wrung(), 20, seed=5)
    columns = [run.path, run.reading, run.branch]
    others = [np.delete(column, crashed, axis=0) for column in columns]
    for column in columns:
        column[crashed] = NOWHERE
    seconds = seconds_of(spread_table(), *columns)
    assert seconds[crashed] == 0.0
    np.testing.assert_allclose(np.delete(seconds, crashed), seconds_of(spread_table(), *others))


@pytest.mark.parametrize("turn_urad", [700_000, -2_500_000])
def test_turned_table_ends_as_the_table_does_for_turned_parts(job, turn_urad):
    table = spread_table()
    drawn = evaluate(table, job, Wrung(), 200, seed=7).initial
    same, off_mm = 0, []
    for start in drawn:
        leaf, path, pose, _ = walk(table, job, start)
        there = walk(turned(table, turn_urad), job, np.array(turned_pose(start, turn_urad / 1e6)))
        same += (leaf, path) == there[:2]
        off_mm.append(np.hypot(*(np.array(turned_pose(pose, turn_urad / 1e6)) - there[2])[:2]))
    assert same >= 198  # places are rounded to 1 um, which may move a reading by a count
    assert np.quantile(off_mm, 0.95) < 0.02


def test_evaluate_part_under_a_finger_crashes_without_a_squeeze(job):
    class Blocked(Wrung):
        """A world in which a finger stands on about half of the parts, so that they are never squeezed."""

        def collides(self, pose, opening_mm):
            return pose[0] > 0.0

    table, wide = spread_table(), job.replaced(uncertainty={"radius_mm": 40.0})
    reach = float(np.max(np.hypot(*job.part.outline_mm.T)))
    world = Blocked()
    run = evaluate(table, wide, world, 600, seed=6)
    first = to_hand(run.initial, placement_of(table.nodes[0].squeeze))
    near = np.abs(first[:, 1]) + reach > 0.5 * table.nodes[0].squeeze.opening_um / 1e3
    stopped = near & (first[:, 0] > 0.0)
    assert 20 < stopped.sum() < 580
    assert np.all(run.leaf[stopped] == CRASHED)
    assert np.all(run.squeezes[stopped] == 0)
    assert np.array_equal(run.poses[stopped], run.initial[stopped])
    ended = [run.success, run.wrong, run.rejected, run.unresolved, run.leaf == CRASHED]
    assert np.all(np.sum(ended, axis=0) == 1)
    assert run.crashes == run.summary()["crashes"] >= stopped.sum()
    assert len(world.seen) == run.squeezes.sum()


def test_evaluate_world_without_a_number_is_refused_by_name(job):
    class Blind(Wrung):
        """A world whose widths are unknown."""

        def squeeze(self, pose):
            after, _, status = super().squeeze(pose)
            return after, float("nan"), status

    with pytest.raises(UsageError, match="the world Blind gives a pose or width"):
        evaluate(spread_table(), job, Blind(), 20, seed=5)
