"""The rehearsal world: branches by their probability, widths that read as their branch, part after part."""

from collections import Counter
from math import sqrt
from random import Random

import pytest
from sample_tables import GRIPPER, random_table, small_table

from runtime.errors import UsageError
from runtime.geometry import compose, goal_distance_mm, placement, relative
from runtime.rehearsal import Rehearsal, make
from runtime.table import REJECT, Calibration, Table, decide, decisions

CALIBRATION = Calibration.linear(GRIPPER)


def play(table: Table, world: Rehearsal, random: Random) -> tuple[int, ...]:
    """One part as a cell without encoder noise would play it: the nodes visited, then the target."""
    pose = (random.uniform(-10, 10), random.uniform(-10, 10), random.uniform(-3, 3))
    path, target = [], 0
    while target >= 0:
        path.append(target)
        node = table.nodes[target]
        frame = placement(node.squeeze)
        final, width_mm, status = world.squeeze(relative(frame, pose))
        pose = compose(frame, final)
        count = CALIBRATION.count(round(width_mm * 1000))
        branch = decide(decisions(node, CALIBRATION), count, status == "grasped")
        assert branch != REJECT
        target = node.branches[branch].target
    return (*path, target)


def test_leaves_are_reached_as_often_as_the_table_says() -> None:
    table, trials = small_table(), 4_000
    world, random = make(table, 3), Random(5)
    seen = Counter(play(table, world, random) for _ in range(trials))
    expected = {(0, ~0): 0.6, (0, 1, ~1): 0.4 * 0.75, (0, 1, ~2): 0.4 * 0.25}
    assert set(seen) == set(expected)
    for path, share in expected.items():
        assert abs(seen[path] / trials - share) < 4 * sqrt(share * (1 - share) / trials)


@pytest.mark.parametrize("seed", range(3))
def test_every_width_of_any_table_reads_as_an_outcome(seed: int) -> None:
    table = random_table(seed, 20)
    world, random = make(table, seed), Random(seed)
    for _ in range(200):
        path = play(table, world, random)
        assert ~path[-1] < len(table.leaves)


def test_same_seed_same_widths() -> None:
    table = small_table()
    runs = [[make(table, 9).squeeze((0.0, 0.0, 0.0))[1] for _ in range(5)] for _ in range(2)]
    assert runs[0] == runs[1]


def test_a_job_without_a_table_cannot_be_rehearsed() -> None:
    with pytest.raises(UsageError, match="start grasp-cell with --tree"):
        make({"seed": 1}, 0)


def test_compose_and_relative_are_inverses() -> None:
    random = Random(1)
    for _ in range(100):
        frame, pose = (tuple(random.uniform(-3, 3) for _ in range(3)) for _ in range(2))
        assert relative(frame, compose(frame, pose)) == pytest.approx(pose, abs=1e-12)


def test_goal_distance_counts_angles_under_the_symmetry() -> None:
    goal = small_table().goal  # rho 10.571 mm, half turns are equal
    assert goal_distance_mm(goal, (0, 0, 0.1), (3, 4, 0.1)) == pytest.approx(5.0)
    assert goal_distance_mm(goal, (0, 0, 0.2), (0, 0, 0.1)) == pytest.approx(1.0571)
    assert goal_distance_mm(goal, (0, 0, 0.0), (0, 0, 3.14159265359)) == pytest.approx(0.0, abs=1e-9)
    assert goal_distance_mm(goal, (0, 0, 0.0), (0, 0, 1.5707963268)) == pytest.approx(16.605, abs=1e-3)
