"""Look-up by the rule: every node, every count, every object flag, against the rule as it is written."""

from dataclasses import FrozenInstanceError

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
    by_count,
    decide,
    decision_map,
    dumps,
)

LINE = Calibration.linear(GRIPPER)
WORN = Calibration(tuple(max(0, width - 260 - width // 300) for width in LINE.widths_um))
TABLES = [small_table(), every_field_table(), random_table(1, 60), grown_table(1, 400)]


def slow_decision(node: Node, width_um: int, object_detected: bool) -> int:
    """Decision 0020: those that the flag admits, contained, nearest expected width, the lower of two."""
    grips, others = [], []
    for number, branch in enumerate(node.branches):
        if branch.low_um <= width_um <= branch.high_um:
            grip = branch.expected_um >= HELD_UM or branch.low_um > 0
            (grips if grip else others).append((abs(width_um - branch.expected_um), number))
    if width_um == 0:
        grips = []
    if object_detected:
        return min(grips)[1] if grips else REJECT
    return min(others or grips)[1] if (others or grips) and width_um <= 5_000 else REJECT


def node_of(*intervals: tuple[int, int, int]) -> Node:
    branches = [
        Branch(low, expected, high, 0, ~at) for at, (low, expected, high) in enumerate(intervals)
    ]
    return Node(small_table().nodes[0].squeeze, tuple(branches))


@pytest.mark.parametrize("calibration", [LINE, WORN], ids=["line", "worn"])
@pytest.mark.parametrize("table", TABLES, ids=["small", "every field", "random", "400 nodes"])
def test_every_node_count_and_flag_is_decided_by_the_rule(
    table: Table, calibration: Calibration
) -> None:
    for node in table.nodes:
        decided = decision_map(node, calibration)
        assert len(decided) == 512
        for count in range(256):
            width = calibration.width_um(count)
            for flag in (False, True):
                assert decide(decided, count, flag) == slow_decision(node, width, flag)


@pytest.mark.parametrize("table", TABLES, ids=["small", "every field", "random", "400 nodes"])
def test_every_branch_of_a_valid_table_is_decided_by_some_reading_and_no_other_reaches_it(
    table,
) -> None:
    dumps(table)  # validates it
    for node in table.nodes:
        decided = decision_map(node, LINE)
        assert set(decided) - {REJECT} == set(range(len(node.branches)))
        assert set(by_count(decided)) - {REJECT} == set(range(len(node.branches)))


def test_a_flag_that_contradicts_the_width_is_rejected() -> None:
    nothing, grip = (0, 0, 900), (20_000, 21_000, 22_000)
    decided = decision_map(node_of(nothing, grip), LINE)
    closed, held = GRIPPER.count_closed, LINE.count(21_000)
    assert decide(decided, closed, felt=False) == 0
    assert decide(decided, held, felt=True) == 1
    assert decide(decided, held, felt=False) == REJECT  # wide, but nothing was felt
    assert decide(decided, closed, felt=True) == REJECT  # something felt where nothing fits
    assert decide(decision_map(node_of((0, 2_000, 4_000)), LINE), closed, felt=True) == REJECT


@pytest.mark.parametrize("count", [-257, -256, -1, 256, 511, 10**9])
def test_what_is_no_count_is_rejected(count: int) -> None:
    """Also where every count has a branch, so that a look-up from the list's end would find one."""
    nothing, any_grip = (0, 0, 1_999), (2_000, 40_000, 85_000)
    for decided in (
        decision_map(small_table().nodes[0], LINE),
        decision_map(node_of(nothing, any_grip), LINE),
    ):
        assert decide(decided, count, felt=True) == REJECT
        assert decide(decided, count, felt=False) == REJECT


def test_a_grip_is_of_two_millimetres_or_reaches_down_to_no_jaws_that_met_and_may_go_unfelt() -> (
    None
):
    """TABLE.md: the flag may miss it up to 5 mm."""
    assert (HELD_UM, REJECT) == (2_000, -1)
    at = LINE.count(1_900)
    for low, expected, grip in ((0, 1_999, False), (0, 2_000, True), (1, 1_999, True)):
        decided = decision_map(node_of((low, expected, 2_500)), LINE)
        assert (decide(decided, at, felt=True) == 0) == grip
        assert decide(decided, at, felt=False) == 0
    wide = decision_map(node_of((2_000, 6_000, 10_000)), LINE)
    widths = [
        width for count, width in enumerate(LINE.widths_um) if decide(wide, count, False) == 0
    ]
    assert max(widths) == max(width for width in LINE.widths_um if width <= 5_000)


def test_the_flag_tells_a_thin_grip_from_jaws_that_met() -> None:
    decided = decision_map(node_of((0, 0, 900), (200, 1_000, 1_900)), LINE)
    dimly = LINE.count(700)
    assert decide(decided, dimly, felt=True) == 1
    assert decide(decided, dimly, felt=False) == 0
    assert decide(decided, LINE.count(1_500), felt=False) == 1  # wider than any empty hand
    assert by_count(decided)[dimly] == 1


def test_jaws_a_micrometre_apart_may_hold_something() -> None:
    almost = Calibration((*[9_000] * 254, 1, 0))
    decided = decision_map(node_of((0, 2_000, 3_000)), almost)
    assert decide(decided, 254, felt=True) == 0
    assert decide(decided, 255, felt=True) == REJECT


def test_a_width_that_two_intervals_share_is_the_nearer_ones() -> None:
    millimetres = Calibration(tuple(range(255_000, -1, -1_000)))
    for below, above, taken in (((20, 24, 25), (25, 29, 30), 0), ((20, 21, 25), (25, 26, 30), 1)):
        node = node_of(*(tuple(1_000 * edge for edge in row) for row in (below, above)))
        assert by_count(decision_map(node, millimetres))[millimetres.count(25_000)] == taken


def test_a_calibration_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        LINE.widths_um = ()
    assert not hasattr(LINE, "__dict__")
    assert Calibration(LINE.widths_um) == LINE
    assert repr(LINE) == f"Calibration(widths_um={LINE.widths_um})"


@pytest.mark.parametrize(
    "node",
    [
        node_of((20_000, 22_000, 30_000), (21_000, 28_000, 40_000)),
        node_of(
            (20_000, 22_000, 60_000), (21_000, 28_000, 29_000)
        ),  # the second one inside the first
        node_of((20_000, 21_000, 50_000), (21_000, 30_000, 45_000), (22_000, 44_000, 70_000)),
        node_of((5_000, 6_000, 7_000), (5_000, 6_374, 7_000), (5_000, 6_748, 7_000)),
        node_of((0, 85_000, 85_000)),
    ],
)
def test_overlapping_and_nested_intervals_follow_the_rule(node: Node) -> None:
    for calibration in (LINE, WORN, Calibration(tuple(range(255_000, -1, -1_000)))):
        decided = decision_map(node, calibration)
        for count in range(256):
            width = calibration.width_um(count)
            assert decide(decided, count, felt=True) == slow_decision(node, width, True)


def test_the_nearest_expected_width_wins_and_the_lower_of_two() -> None:
    node = node_of((20_000, 22_000, 30_000), (21_000, 28_000, 40_000))
    millimetres = Calibration(tuple(range(255_000, -1, -1_000)))
    outcomes = by_count(decision_map(node, millimetres))
    assert outcomes[millimetres.count(25_000)] == 0  # equally near to both
    assert outcomes[millimetres.count(26_000)] == 1


def test_linear_calibration_is_robotiqs_line() -> None:
    # Robotiq SDK, units.cpp: opening_mm = 85 * (230 - gPO) / 227, clamped; 0.374 mm a count.
    for count in range(256):
        assert LINE.width_um(count) == pytest.approx(
            min(max(85e3 * (230 - count) / 227, 0), 85e3), abs=0.5
        )
    assert LINE.count(21_000) == 174


@pytest.mark.parametrize("calibration", [LINE, WORN], ids=["line", "worn"])
@pytest.mark.parametrize(
    ("low", "high"), [(0, 85_000), (20_000, 22_000), (21_001, 21_001), (90_000, 99_000)]
)
def test_counts_of_an_interval_are_those_whose_widths_lie_in_it(
    calibration, low: int, high: int
) -> None:
    inside = [count for count in range(256) if low <= calibration.width_um(count) <= high]
    assert list(calibration.counts(low, high)) == inside


def test_calibration_that_rises_is_refused() -> None:
    with pytest.raises(TableError, match="must not rise with the count; they do at 1"):
        Calibration((5, 6, *([0] * 254)))
    for widths in ((5, 4), (0,) * 255, (0,) * 257):
        message = f"a calibration has 256 widths, this one has {len(widths)}"
        with pytest.raises(TableError, match=message):
            Calibration(widths)
