"""Validation of a table: the last value that is allowed, the first that is refused, and the reason."""

import hashlib
from dataclasses import replace

import pytest
from refusals import refused_in_a_line
from sample_tables import GRIPPER, PUSHES, changed, every_field_table, small_table, with_job

from runtime.table import (
    PPM,
    Area,
    Branch,
    Leaf,
    LeafPose,
    Node,
    Place,
    Prediction,
    Table,
    TableError,
    Tolerance,
    dumps,
    job_of,
)
from runtime.table.validation import validate

TABLE = small_table()
UNTRIED = replace(
    TABLE, predicted=Prediction(0, 0, 0)
)  # without trials the leaves may have any figures


def one_node(*rows: tuple[int, int, int]) -> Table:
    """A table of one node: branches with these intervals lead to leaves 0, 1, ... in equal shares."""
    share, rest = divmod(PPM, len(rows))
    ppm = [share + (at < rest) for at in range(len(rows))]
    branches = tuple(Branch(*row, ppm[at], ~at) for at, row in enumerate(rows))
    leaves = tuple(TABLE.leaves[0] for _ in rows)
    return replace(UNTRIED, nodes=(Node(TABLE.nodes[0].squeeze, branches),), leaves=leaves)


def but(path: str, value: object) -> Table:
    """The small table, not evaluated, with a push at its root and with the field `path` set to `value`."""
    return changed(UNTRIED, {"nodes.0.pushes": PUSHES[:1], path: value})


# -- edges ----------------------------------------------------------------------------------------

# The field, the last value that is allowed and the next one.
FIELDS = [
    ("nodes.1.squeeze.x_um", 60_000, 60_001, "node 1: x_um is 60001, allowed is -60000..60000"),
    ("nodes.1.squeeze.opening_um", 85_000, 85_001, "node 1: opening_um is 85001"),
    ("nodes.1.squeeze.force_mn", 60_000, 60_001, "node 1: force_mn is 60001"),
    ("nodes.1.squeeze.speed_um_s", 1, 0, "node 1: speed_um_s is 0, allowed is 1..60000"),
    ("nodes.1.squeeze.clearance_um", 0, -1, "node 1: clearance_um is -1"),
    ("nodes.1.squeeze.angle_urad", -3_142_000, -3_142_001, "node 1: angle_urad is -3142001"),
    ("nodes.1.branches.1.high_um", 85_000, 85_001, "branch 1: high_um is"),
    ("nodes.0.branches.0.probability_ppm", 600_002, 600_003, "sum to 1000003 ppm, not 1000000"),
    ("leaves.0.x_um", 60_000, -60_001, "leaf 0: x_um is -60001, allowed is -60000..60000"),
    ("leaves.0.covariance.xx", 0, -1, "leaf 0: covariance.xx is -1"),
    ("leaves.0.success_ppm", 990_000, 985_000, "0.9850 of 6000 trials met the goal, which"),
    ("limits.max_depth", 2, 1, "node 1 is deeper than limits.max_depth = 1"),
    ("limits.max_depth", 64, 65, "limits.max_depth is 65, allowed is 1..64"),
    ("limits.retreat_height_um", 10_001, 10_000, "limits.retreat_height_um is 10000"),
    ("limits.work_area_um", TABLE.limits.work_area_um, Area(0, 0, -1, 1), "x_max is -1"),
    ("goal.symmetry", 1, 0, "goal.symmetry is 0"),
    ("gripper.steps", 170, 0, "gripper.steps is 0, allowed is 1.."),
    ("nodes.0.contact_um", 84_999, 85_000, "node 0: contact_um is 85000, allowed is 30000.."),
    ("nodes.0.release", Place(0, 60_000), Place(0, 60_001), "node 0, release 0: y_um is 60001"),
    ("nodes.1.release", Place(0, 0), Place(1_000, -2_000), "node 1: its release is where it"),
    ("nodes.0.pushes", PUSHES[:1] * 4, PUSHES[:1] * 5, "number of pushes is 5, allowed is 0..4"),
    ("nodes.0.pushes.0.length_um", 110_000, 110_001, "push 0: x_um of its end is 60001"),
    ("nodes.0.pushes.0.length_um", 1, 0, "node 0, push 0: length_um is 0"),
    ("nodes.0.pushes.0.opening_um", 85_000, 85_001, "node 0, push 0: opening_um is"),
    ("nodes.0.pushes.0.speed_um_s", 400_000, 400_001, "node 0, push 0: speed_um_s is"),
    ("job_digest", TABLE.job_digest, b"short", "length of job_digest is 5"),
    ("nodes", TABLE.nodes, (), "number of nodes is 0"),
]
TWO_POSES = "leaf 0: 2 poses are more than the goal allows; mark it unresolved"
NEAREST_TAKEN = "node 0, branch 1: expected_um is 21000, allowed is 21001..22000"
# Without trials of the leaves, since measured errors limit the goal, too.
LEAVES_UNTRIED = replace(UNTRIED, leaves=tuple(leaf._replace(trials=0) for leaf in TABLE.leaves))
IN_TOLERANCES = {"goal.kind": "tolerances", "goal.tolerance": Tolerance(1, 1, 1)}
NONE_GOOD = {"leaves.0.success_ppm": 0, "leaves.0.trials": 0}
AMBIGUOUS = {"leaves.0.alternatives": (LeafPose(0, 0, 1),), "leaves.0.resolved": False}
BUTS = [
    (LEAVES_UNTRIED, {"goal.distance_um": 1}, {"goal.distance_um": 0}, "goal.distance_um is 0"),
    (UNTRIED, NONE_GOOD, NONE_GOOD | {"leaves.0.trials": 2}, "refutes the"),
    (UNTRIED, AMBIGUOUS, AMBIGUOUS | {"leaves.0.resolved": True}, TWO_POSES),
    (UNTRIED, IN_TOLERANCES, IN_TOLERANCES | {"goal.tolerance.y_um": 0}, "tolerance.y_um is 0"),
]
EDGES = [(but(path, last), but(path, following), said) for path, last, following, said in FIELDS]
EDGES += [(changed(table, last), changed(table, after), said) for table, last, after, said in BUTS]
ROW = (20_000, 21_000, 22_000)
WIDE, NARROW = one_node((20_000, 20_100, 20_300)), one_node((20_100, 20_150, 20_200))
EDGES += [
    (one_node(ROW, (20_000, 21_500, 22_000)), one_node(ROW, ROW), NEAREST_TAKEN),
    (WIDE, NARROW, "node 0, branch 0: no reading means 20.10..20.20 mm; widen it"),
]


@pytest.mark.parametrize(("allowed", "refused", "message"), EDGES, ids=[edge[2] for edge in EDGES])
def test_validate_at_an_edge_allows_the_last_value_and_refuses_the_next(allowed, refused, message):
    dumps(allowed)
    with pytest.raises(TableError) as result:
        dumps(refused)
    assert message in str(result.value)


def test_validate_leaf_with_more_poses_than_goal_allows_is_refused():
    modes = {"goal.kind": "modes", "goal.modes": 2, "leaves.0.alternatives": (LeafPose(0, 0, 1),)}
    two = changed(UNTRIED, modes)
    dumps(two)
    with pytest.raises(TableError, match="leaf 0: y_um is 60001"):
        dumps(changed(two, {"leaves.0.alternatives.0.y_um": 60_001}))
    with pytest.raises(TableError, match="2 poses are more"):
        dumps(changed(two, {"goal.kind": "pose"}))


def test_validate_grip_that_only_closed_jaws_read_is_refused():
    """The grip's interval contains only the reading of closed jaws, and this reading never means a grip."""
    dumps(one_node((0, 0, 0)))
    wide = replace(one_node((0, 2_000, 2_000)), gripper=replace(GRIPPER, steps=2))  # 0, 42.5, 85 mm
    with pytest.raises(TableError, match=r"no reading means 0\.00\.\.2\.00 mm"):
        dumps(wide)


# -- the tree -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (but("nodes.1.branches.0.target", 1), "branch 0: target is 1, where breadth first it is 2"),
        (but("nodes.1.branches.0.target", ~2), "target is -3, where breadth first it is -2"),
        (but("nodes.1.branches.0.target", 7), "target is 7, where breadth first it is 2"),
        (but("nodes.0.branches.1.target", ~1), "node 1 is never reached"),
        (replace(TABLE, nodes=TABLE.nodes[:1]), "node 1 is missing"),
        (replace(TABLE, leaves=TABLE.leaves[:2]), "leaf 2 is missing"),
        (replace(TABLE, leaves=TABLE.leaves * 2), "leaf 3 is never reached"),
    ],
)
def test_validate_tree_not_numbered_breadth_first_is_refused(table, message):
    with pytest.raises(TableError) as result:
        dumps(table)
    assert message in str(result.value)


def test_validate_chain_of_64_nodes_obeys_max_depth():
    first, second = TABLE.nodes[0].branches
    nodes = [
        Node(TABLE.nodes[0].squeeze, (first._replace(target=~at), second._replace(target=at + 1)))
        for at in range(63)
    ]
    ends = (first._replace(target=~63), second._replace(target=~64))
    nodes.append(TABLE.nodes[0]._replace(branches=ends))
    leaves: tuple[Leaf, ...] = (TABLE.leaves[0],) * 65
    chain = replace(UNTRIED, nodes=tuple(nodes), leaves=leaves)
    dumps(changed(chain, {"limits.max_depth": 64}))
    with pytest.raises(TableError, match=r"node 63 is deeper than limits\.max_depth = 63"):
        dumps(changed(chain, {"limits.max_depth": 63}))


# -- the embedded job -----------------------------------------------------------------------------


def test_job_of_table_is_embedded_job_or_none():
    assert job_of(every_field_table()) == {"seed": 1}
    assert job_of(TABLE) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "the embedded job is "),
        ('{"seed":' + "9" * 10_000 + "}", "the embedded job is "),
        ("{", "the embedded job is "),
        ("[]", "the embedded job is no JSON object"),
    ],
    ids=["nested deep", "long number", "cut short", "no object"],
)
def test_validate_unreadable_job_is_refused_in_one_line(text, message):
    with refused_in_a_line(TableError, message) as result:
        dumps(with_job(TABLE, text))
    assert len(str(result.value)) < 250


def test_validate_job_with_another_digest_is_refused():
    with pytest.raises(TableError, match="not the one the table was made from"):
        validate(replace(TABLE, job="{}"))
    dumps(replace(TABLE, job="{}", job_digest=hashlib.sha256(b"{}").digest()))
