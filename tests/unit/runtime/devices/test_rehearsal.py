"""The rehearsal world draws a branch by its probability, and returns a width that leads to this branch."""

from collections import Counter
from math import cos, pi, sin, sqrt
from random import Random

import pytest
from counting import count_of, width_um
from sample_tables import random_table, small_table

from runtime.devices.rehearsal import Rehearsal, make
from runtime.shell.errors import UsageError
from runtime.table import REJECT, Pose2, Table, decide, decision_map
from runtime.table.geometry import compose, placement

ROUND = (0.0, pi)


def relative(frame: Pose2, pose: Pose2) -> Pose2:
    """The inverse of `compose`: a pose seen from `frame`."""
    dx, dy = pose[0] - frame[0], pose[1] - frame[1]
    c, s = cos(frame[2]), sin(frame[2])
    return c * dx + s * dy, -s * dx + c * dy, pose[2] - frame[2]


def play(table: Table, world: Rehearsal, random: Random) -> tuple[int, ...]:
    """The nodes that one part visits in a cell without encoder noise, then the target of its leaf.

    The hand stands at the node's angle or half a turn from it.
    """
    pose = (random.uniform(-10, 10), random.uniform(-10, 10), random.uniform(-3, 3))
    path, target = [], 0
    while target >= 0:
        path.append(target)
        node = table.nodes[target]
        x_mm, y_mm, angle_rad = placement(node.squeeze)
        frame = x_mm, y_mm, angle_rad + random.choice(ROUND)
        final, width_mm, status = world.squeeze(relative(frame, pose))
        pose = compose(frame, final)
        read_um = width_um(count_of(round(width_mm * 1000)))
        branch = decide(decision_map(node, table.gripper), read_um, status == "grasped")
        assert branch != REJECT
        target = node.branches[branch].target
    return (*path, target)


def test_rehearsal_frequencies_of_leaves_match_table():
    table, trials = small_table(), 1_000
    world, random = make(table, 3), Random(5)
    seen = Counter(play(table, world, random) for _ in range(trials))
    expected = {(0, ~0): 0.6, (0, 1, ~1): 0.4 * 0.75, (0, 1, ~2): 0.4 * 0.25}
    assert set(seen) == set(expected)
    for path, share in expected.items():
        assert abs(seen[path] / trials - share) < 4 * sqrt(share * (1 - share) / trials)


@pytest.mark.parametrize("seed", range(3))
def test_rehearsal_of_any_table_gives_widths_of_its_branches(seed):
    table = random_table(seed, 20)
    world, random = make(table, seed), Random(seed)
    for _ in range(60):
        path = play(table, world, random)
        assert ~path[-1] < len(table.leaves)


def test_make_rehearsal_of_job_without_table_is_refused():
    with pytest.raises(UsageError, match="start grasp-cell with --tree"):
        make({"seed": 1}, 0)
