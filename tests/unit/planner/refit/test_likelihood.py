from pathlib import Path

import numpy as np
import pytest

from planner.evaluation.expectation import readings
from planner.job import model
from planner.refit.cells import Cells
from planner.refit.likelihood import Seen, log_likelihood, pooled, usual
from runtime.table import load, predicted_pose

TREE = Path(__file__).parents[4] / "trees" / "rectangle" / "rectangle.msgpack"


@pytest.fixture(scope="module")
def cells():
    table = load(TREE).table
    return Cells.of(model.from_canonical(table.job), table)


def at(cells, **told):
    usual = dict.fromkeys(("finger_share", "middle_mm", "encoder_mm"), 0.0)
    values = usual | {"finger_part_min": 0.4, "finger_part_max": 0.6} | told
    return np.array([*(values[quantity.key] for quantity in cells.space.quantities), 0.0])


def seen_of(run, nodes):
    """What the journals of a cell would hold, without audits."""
    return Seen(readings(run, nodes), len(run.leaf), np.zeros(0, np.int64), np.zeros((0, 3)))


@pytest.fixture(scope="module")
def expected(cells):
    """What is read in cells of the prior."""
    points, nodes = cells.space.draw(40, np.random.default_rng(8)), len(cells.program.table.nodes)
    counts = sum(readings(cells.run(point, 200, k), nodes) for k, point in enumerate(points))
    return usual(counts, cells.program.table)


def test_what_is_usual_is_shares_of_every_count_at_every_node(cells, expected):
    assert expected.shape == (len(cells.program.table.nodes), 256)
    assert (expected > 0.0).all()
    np.testing.assert_allclose(expected.sum(axis=1), 1.0)


def test_fewer_simulated_parts_make_no_friction_likelier(cells, expected):
    """The mean over simulations of 400 parts against 8000, in nats for 100 parts that were seen."""
    table = cells.program.table
    true = at(cells, encoder_mm=0.1, finger_part_min=0.35, finger_part_max=0.55)
    seen = seen_of(cells.run(true, 2000, 1), len(table.nodes))
    told = []
    for low in (0.2, 0.35, 0.5):
        point = at(cells, encoder_mm=0.1, finger_part_min=low, finger_part_max=0.55)
        few = [log_likelihood(seen, cells.run(point, 400, 10 + k), table, expected) for k in range(6)]
        told.append(np.mean(few) - log_likelihood(seen, cells.run(point, 8000, 9), table, expected))
    assert np.ptp(told) * 100 / seen.parts < 8.0


def test_what_happened_is_likelier_where_it_happened(cells, expected):
    table = cells.program.table
    true = at(cells, encoder_mm=0.6, finger_part_min=0.25, finger_part_max=0.35)
    seen = seen_of(cells.run(true, 100, 1), len(table.nodes))
    best = log_likelihood(seen, cells.run(true, 600, 2), table, expected)
    for other in (at(cells), at(cells, encoder_mm=0.8, finger_part_min=0.25, finger_part_max=0.35)):
        assert best - log_likelihood(seen, cells.run(other, 600, 2), table, expected) > 10.0


def test_measured_poses_tell_where_the_fingers_meet(cells, expected):
    """The widths of a centred rectangle do not (they stay what they are when the part is moved)."""
    table = cells.program.table
    true = at(cells, middle_mm=2.0)
    run = cells.run(true, 60, 3)
    resolved = np.flatnonzero(run.resolved)
    poses = np.array([predicted_pose(table.leaves[leaf]) for leaf in run.leaf[resolved]])
    off = run.poses[resolved] - poses
    off[:, 2] -= np.pi * np.round(off[:, 2] / np.pi)
    seen = seen_of(run, len(table.nodes))
    audited = seen._replace(leaves=run.leaf[resolved], residuals=off)
    for told, least in ((audited, 20.0), (seen, -10.0)):
        here, there = (cells.run(point, 600, 4) for point in (true, at(cells)))
        gain = log_likelihood(told, here, table, expected) - log_likelihood(told, there, table, expected)
        assert gain > least
    assert gain < 20.0


def test_what_an_empty_hand_reads_is_one_reading(cells):
    counts = np.arange(256)[None].repeat(2, axis=0)
    one = pooled(counts, cells.program.table)
    assert (one.sum(axis=1) == counts.sum(axis=1)).all()
    assert np.array_equal(one[:, :220], counts[:, :220])
    assert np.count_nonzero(one[0, 220:]) < np.count_nonzero(counts[0, 220:])
