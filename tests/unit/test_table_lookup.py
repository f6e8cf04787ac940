"""Look-up by the rule: every node, every count, every object flag, against the rule as it is written."""

import pytest
from grown_tables import grown_table
from sample_tables import GRIPPER, every_field_table, random_table, small_table

from runtime.table import (
    HELD_UM,
    REJECT,
    Branch,
    Calibration,
    Node,
    Table,
    TableError,
    canonical,
    count_map,
    decide,
    decisions,
    prove,
)
from runtime.table_lookup import won
from runtime.table_proof import unreadable

LINE = Calibration.linear(GRIPPER)
WORN = Calibration(tuple(max(0, width - 260 - width // 300) for width in LINE.widths_um))
TABLES = [
    canonical(t) for t in (small_table(), every_field_table(), random_table(1, 60), grown_table(1, 400))
]


def slow_decision(node: Node, width_um: int, object_detected: bool) -> int:
    """Contained, nearest expected width, the lower of two; a grip needs an object and a width."""
    held = [
        (abs(width_um - branch.expected_um), number)
        for number, branch in enumerate(node.branches)
        if branch.low_um <= width_um <= branch.high_um
    ]
    if not held:
        return REJECT
    number = min(held)[1]
    grip = node.branches[number].expected_um >= HELD_UM
    if grip != object_detected or (grip and width_um == 0):
        return REJECT
    return number


def node_of(*intervals: tuple[int, int, int]) -> Node:
    branches = [Branch(low, expected, high, 0, ~at) for at, (low, expected, high) in enumerate(intervals)]
    return Node(small_table().nodes[0].squeeze, tuple(branches))


@pytest.mark.parametrize("calibration", [LINE, WORN], ids=["line", "worn"])
@pytest.mark.parametrize("table", TABLES, ids=["small", "every field", "random", "400 nodes"])
def test_every_node_count_and_flag_is_decided_by_the_rule(table: Table, calibration: Calibration) -> None:
    for node in table.nodes:
        decided = decisions(node, calibration)
        assert len(decided) == 512
        for count in range(256):
            width = calibration.width_um(count)
            for flag in (False, True):
                assert decide(decided, count, flag) == slow_decision(node, width, flag)


@pytest.mark.parametrize("table", TABLES, ids=["small", "every field", "random", "400 nodes"])
def test_every_branch_of_a_proved_table_is_decided_by_some_reading_and_no_other_reaches_it(table) -> None:
    prove(table)
    for node in table.nodes:
        decided = decisions(node, LINE)
        assert set(decided) - {REJECT} == set(range(len(node.branches)))
        assert set(count_map(node, LINE)) - {REJECT} == set(range(len(node.branches)))


def test_a_flag_that_contradicts_the_width_is_rejected() -> None:
    nothing, grip = (0, 0, 900), (20_000, 21_000, 22_000)
    decided = decisions(node_of(nothing, grip), LINE)
    closed, held = GRIPPER.count_closed, LINE.count(21_000)
    assert decide(decided, closed, object_detected=False) == 0
    assert decide(decided, held, object_detected=True) == 1
    assert decide(decided, held, object_detected=False) == REJECT  # a width, but nothing was felt
    assert decide(decided, closed, object_detected=True) == REJECT  # something felt where nothing fits
    assert decide(decisions(node_of((0, 2_000, 4_000)), LINE), closed, object_detected=True) == REJECT


@pytest.mark.parametrize("count", [-1, 256, -256, 10**9])
def test_what_is_no_count_is_rejected(count: int) -> None:
    decided = decisions(small_table().nodes[0], LINE)
    assert decide(decided, count, object_detected=True) == REJECT
    assert decide(decided, count, object_detected=False) == REJECT


@pytest.mark.parametrize(
    "node",
    [
        node_of((20_000, 22_000, 30_000), (21_000, 28_000, 40_000)),
        node_of((20_000, 22_000, 60_000), (21_000, 28_000, 29_000)),  # the second one inside the first
        node_of((20_000, 21_000, 50_000), (21_000, 30_000, 45_000), (22_000, 44_000, 70_000)),
        node_of((5_000, 6_000, 7_000), (5_000, 6_374, 7_000), (5_000, 6_748, 7_000)),
        node_of((0, 85_000, 85_000)),
    ],
)
def test_overlapping_and_nested_intervals_follow_the_rule(node: Node) -> None:
    for calibration in (LINE, WORN, Calibration(tuple(range(255_000, -1, -1_000)))):
        decided = decisions(node, calibration)
        for count in range(256):
            width = calibration.width_um(count)
            assert decide(decided, count, object_detected=True) == slow_decision(node, width, True)
        missing = set(range(len(node.branches))) - set(decided)
        assert unreadable(node, calibration) == sorted(missing)


def test_the_nearest_expected_width_wins_and_the_lower_of_two() -> None:
    node = node_of((20_000, 22_000, 30_000), (21_000, 28_000, 40_000))
    millimetres = Calibration(tuple(range(255_000, -1, -1_000)))
    outcomes = count_map(node, millimetres)
    assert outcomes[millimetres.count(25_000)] == 0  # equally near to both
    assert outcomes[millimetres.count(26_000)] == 1
    assert won(node.branches) == [(20_000, 25_000), (25_001, 40_000)]


def test_linear_calibration_is_robotiqs_line() -> None:
    # Robotiq SDK, units.cpp: opening_mm = 85 * (230 - gPO) / 227, clamped; 0.374 mm a count.
    for count in range(256):
        assert LINE.width_um(count) == pytest.approx(min(max(85e3 * (230 - count) / 227, 0), 85e3), abs=0.5)
    assert LINE.count(21_000) == 174


@pytest.mark.parametrize("calibration", [LINE, WORN], ids=["line", "worn"])
@pytest.mark.parametrize(("low", "high"), [(0, 85_000), (20_000, 22_000), (21_001, 21_001), (90_000, 99_000)])
def test_counts_of_an_interval_are_those_whose_widths_lie_in_it(calibration, low: int, high: int) -> None:
    inside = [count for count in range(256) if low <= calibration.width_um(count) <= high]
    assert list(calibration.counts(low, high)) == inside
    assert calibration.means(low, high) == bool(inside)


def test_calibration_that_rises_is_refused() -> None:
    with pytest.raises(TableError, match="must not rise with the count; they do at 1"):
        Calibration((5, 6, *([0] * 254)))
    with pytest.raises(TableError, match="256 widths"):
        Calibration((5, 4))
