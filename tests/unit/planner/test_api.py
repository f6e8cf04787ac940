"""The Python interface: look-ups equal those of the runtime, and invalid numbers are refused."""

from dataclasses import replace

import numpy as np
import pytest
from counting import COUNTS, by_count, width_um
from rectangle import JOB_PATH, TABLE_PATH
from refusals import refused_in_a_line

from planner.api import Belief, ContactWorld, Job, Pomdp, Simulator, Table, evaluate, squeeze
from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of
from planner.belief.transition import Outcomes
from planner.compile import compile_job
from planner.mechanics.clearance import Jaws
from planner.mechanics.simulator import Parameters, RollOut
from planner.mechanics.traits import Traits, as_planned
from planner.world import Assorted, by_world
from runtime.shell.errors import ExpectedError
from runtime.table import REJECT, Branch, decision_map


@pytest.fixture(scope="module")
def table():
    return Table.load(TABLE_PATH)


def test_lookup_any_node_and_reading_equals_decision_map(table):
    widths = np.array([width_um(count) for count in range(COUNTS)]) / 1e3
    for number, node in enumerate(table.record.nodes):
        result = table.lookup(np.full(COUNTS, number), widths)
        for count, branch in enumerate(by_count(decision_map(node, table.record.gripper))):
            target = None if branch == REJECT else node.branches[branch].target
            leads = target if target is not None and target >= 0 else -1
            ends = ~target if target is not None and target < 0 else -1
            assert (result.nodes[count], result.leaves[count]) == (leads, ends)


def test_lookup_width_of_a_grip_and_of_an_empty_hand_leads_to_the_grip(table):
    first = table.record.nodes[0]
    empty, grip = Branch(0, 0, 500, 0, target=1), Branch(100, 300, 900, 1_000_000, target=~0)
    node = first._replace(branches=(empty, grip))
    result = Table.of(replace(table.record, nodes=(node,))).lookup([0, 0, 0], [0.0, 0.3, 0.05])
    assert result.nodes.tolist() == [1, -1, 1]
    assert result.leaves.tolist() == [-1, 0, -1]


def test_table_saved_after_load_has_the_same_bytes_and_job(table, tmp_path):
    table.save(tmp_path / "again.msgpack")
    assert (tmp_path / "again.msgpack").read_bytes() == TABLE_PATH.read_bytes()
    assert table.job == Job.load(JOB_PATH)


@pytest.fixture(scope="module")
def evaluation(table):
    return evaluate(table, trials=1500, seed=5, workers=1)


def test_evaluate_same_seed_and_other_workers_is_identical(table, evaluation):
    other = evaluate(table, trials=1500, seed=5, workers=2)
    assert np.array_equal(other.poses, evaluation.poses)


def test_evaluate_other_seed_differs(table, evaluation):
    other = evaluate(table, trials=1500, seed=6)
    assert not np.array_equal(other.poses, evaluation.poses)


def test_evaluate_successes_lie_within_3_mm_of_resolved_leaves(table, evaluation):
    leaf, success = evaluation.leaf, evaluation.success
    assert table.resolved[leaf[success]].all()
    off_mm = np.hypot(*(table.poses[leaf] - evaluation.poses)[success, :2].T)
    assert off_mm.max() < 3.0


def test_evaluate_table_without_job_raises(table):
    stripped = Table.of(replace(table.record, job=None))
    with pytest.raises(ExpectedError, match="carries no job"):
        evaluate(stripped, trials=10)


JOB = Job.load(JOB_PATH)
UNKNOWN = as_planned(2)
UNKNOWN["hypothesis"] = -1
RNG = np.random.default_rng(0)
NAN = float("nan")


@pytest.fixture(scope="module")
def world():
    return ContactWorld(JOB, 0, workers=1)


@pytest.fixture(scope="module")
def model():
    simulator = Simulator.of_job(JOB, 1)
    return Pomdp(JOB, simulator, encoder_of(JOB), metric_of(JOB), 100.0, 1, np.zeros((1, 4)))


@pytest.mark.parametrize(
    ("nodes", "widths", "message"),
    [
        ([-1], [0], "nodes holds -1; there are 0 to [0-9]+$"),
        ([10_000], [0], "nodes holds 10000"),
        ([0], [-1.0], "widths"),
        ([0], [85.1], "widths"),
        ([0, 1], [0], "2 nodes, 1 widths"),
        ([0.5], [0], "pass whole numbers"),
        ([NAN], [0], "pass whole numbers"),
        (0, 0, "pass whole numbers"),
    ],
)
def test_lookup_invalid_node_or_width_raises(table, nodes, widths, message):
    with pytest.raises(ValueError, match=message):
        table.lookup(np.array(nodes), np.array(widths))


POSES = [
    (np.zeros((5, 2)), "shape"),
    (np.zeros(3), "shape"),
    (np.zeros((1, 5, 3)), "shape"),
    (np.full((4, 3), NAN), "holds nan; pass finite numbers"),
    (np.array([[0.0, np.inf, 0.0]]), "holds inf"),
    (np.array([[0.0, 0.0, 1e9]]), r"holds 1e\+09"),
    ([["a", 0, 0]], "no array of numbers"),
]


@pytest.mark.parametrize(
    ("change", "beside_mm"),
    [
        ({"doubt": {"middle_mm": [2.0, 4.0]}}, 3.0),
        ({"gripper": {"upper_finger_share": 0.4}}, (0.5 - 0.4) * (85.0 - 60.0)),
    ],
)
def test_world_middle_of_fingers_off_collides_at_the_shifted_pose(change, beside_mm):
    """All poses at which the part collides lie farther along y, by as much as the fingers' middle does."""
    off = Job.load(JOB_PATH).replaced(**change)
    plain, shifted = ContactWorld(Job.load(JOB_PATH), 0), ContactWorld(off, 0)
    across = np.linspace(-60.0, 60.0, 121)
    expected = [plain.collides((0.0, y, 0.3), 60.0) for y in across]
    assert 0 < sum(expected) < len(across)
    assert [shifted.collides((0.0, y + beside_mm, 0.3), 60.0) for y in across] == expected


@pytest.mark.parametrize(("poses", "message"), POSES)
def test_api_invalid_poses_raise(world, model, poses, message):
    simulator = model.simulator
    size = np.shape(poses)[0]
    calls = [
        lambda: simulator.squeeze(poses, RNG),
        lambda: simulator.roll_out(poses, simulator.nominal(size, 0.5)),
        lambda: simulator.push_by_hand(poses, np.zeros(size), np.ones(size), RNG),
        lambda: world.squeeze_many(poses),
        lambda: world.push_many(poses, np.zeros(size), np.ones(size)),
    ]
    if np.ndim(poses) == 2:
        columns = np.column_stack([np.asarray(poses, dtype=object), np.zeros(size)])
        calls.append(lambda: model.sample(columns, np.zeros(4), RNG))
        calls.append(lambda: model.likelihood(100, columns, np.zeros(4)))
    if np.asarray(poses).dtype == np.float64 and np.ndim(poses) == 2:
        calls.append(lambda: squeeze(JOB, Belief.of(poses), np.zeros(3), RNG, workers=1))
    if np.size(poses) <= 3:
        one = np.ravel(np.asarray(poses, dtype=object)) if np.ndim(poses) > 1 else [0.0, 0.0]
        calls += [
            lambda: world.squeeze(one),
            lambda: world.push(one, 0.0, 1.0),
            lambda: world.collides(one, 85.0),
            lambda: simulator.trace(one, simulator.nominal(1, 0.5).surfaces[0], 0.5),
            lambda: squeeze(JOB, Belief.of(np.zeros((10, 3))), one, RNG, workers=1),
        ]
    for call in calls:
        with pytest.raises(ValueError, match=r"shape|holds|no array of numbers"):
            call()
    with pytest.raises(ValueError, match=message):
        calls[2]()


def squeezed(belief: Belief) -> Outcomes:
    return squeeze(JOB, belief, np.zeros(3), RNG, workers=1)


def rolled_with(model: Pomdp, **changes: np.ndarray) -> RollOut:
    """Computes three squeezes with random parameters, of which `changes` replaces some."""
    return rolled(model, model.simulator.sample(3, RNG)._replace(**changes))


def rolled(model: Pomdp, parameters: Parameters) -> RollOut:
    return model.simulator.roll_out(np.zeros((3, 3)), parameters)


def traits_with(**changes: float) -> Traits:
    """The planned traits of three parts, of which `changes` replaces some."""
    traits = as_planned(3)
    for name, value in changes.items():
        traits[name] = value
    return traits


@pytest.mark.parametrize(
    "wrong",
    [
        lambda world, model: world.push((0.0, 0.0, 0.0), 0.0, 1e9),
        lambda world, model: world.push((0.0, 0.0, 0.0), 0.0, -1.0),
        lambda world, model: world.push((0.0, 0.0, 0.0), NAN, 1.0),
        lambda world, model: world.push_many(np.zeros((3, 3)), np.zeros(2), np.ones(3)),
        lambda world, model: world.squeeze_many(np.zeros((3, 3)), as_planned(2)),
        lambda world, model: world.collides((0.0, 0.0, 0.0), NAN),
        lambda world, model: rolled(model, model.simulator.nominal(2, 0.5)),
        lambda world, model: model.simulator.nominal(2, NAN),
        lambda world, model: model.simulator.trace(np.zeros(3), np.full((3, 3), NAN), 0.5),
        lambda world, model: model.initial(-1, RNG),
        lambda world, model: model.likelihood(256, np.zeros((2, 4)), np.zeros(4)),
        lambda world, model: model.updated(np.zeros((2, 4)), np.zeros(4), 1.5, RNG),
        lambda world, model: squeezed(Belief.of(np.zeros((0, 3)))),
        lambda world, model: squeezed(Belief(np.zeros((3, 3)), as_planned(2), np.zeros(3))),
        lambda world, model: evaluate(Table.load(TABLE_PATH), trials=10, workers=0),
        lambda world, model: evaluate(Table.load(TABLE_PATH), trials=10, seed=-1),
        lambda world, model: compile_job(JOB, trials=-5),
        lambda world, model: list(by_world(Assorted([world, world]), UNKNOWN)),
        lambda world, model: Simulator.of_job(JOB, 1, NAN),
        lambda world, model: replace(model.simulator, jaws=Jaws(NAN, 1.0, 1.0, 0.5)),
        lambda world, model: replace(model.simulator, outline=np.zeros((2, 2))),
        lambda world, model: replace(model.simulator, friction=(NAN, NAN)),
        lambda world, model: rolled_with(model, deviation=np.zeros((3, 1))),
        lambda world, model: rolled_with(model, share=np.full(3, NAN)),
        lambda world, model: rolled_with(model, release=np.full((3, 3), NAN)),
        lambda world, model: world.squeeze_many(np.zeros((3, 3)), traits_with(surface=99)),
        lambda world, model: world.squeeze_many(np.zeros((3, 3)), np.zeros(3)),
        lambda world, model: world.squeeze_many(np.zeros((3, 3)) + 1j),
        lambda world, model: model.likelihood(100, np.zeros((2, 4)), np.zeros(3)),
    ],
)
def test_api_invalid_numbers_raise_with_one_line(world, model, wrong):
    with refused_in_a_line(ValueError, r"pass|there are"):
        wrong(world, model)
