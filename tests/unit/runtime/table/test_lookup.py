"""Look-up: every node, width and object flag against a plain implementation of the rule."""

from dataclasses import replace

import pytest
from counting import by_count
from sample_tables import GRIPPER, every_field_table, random_table, small_table

from runtime.table import (
    HELD_UM,
    REJECT,
    Branch,
    Calibration,
    Node,
    TableError,
    decide,
    decision_map,
    dumps,
)

LINE = Calibration(GRIPPER.profile)
POINTS = tuple((x, max(0, x - 260 - x // 300)) for x in (-9_000, 0, 86_000))
WORN = Calibration(GRIPPER.profile, POINTS)
TABLES = [small_table(), every_field_table(), random_table(1, 60), random_table(2, 120)]


def slow_decision(node: Node, width_um: int, object_detected: bool) -> int:
    """Slow reference version of the look-up, by the rule of decision 0056.

    Of the branches that interval and flag admit, it returns the one whose expected width is nearest to the
    reading; of two equally near, the one with the lower number.
    """
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
    branches = (Branch(*interval, 0, ~at) for at, interval in enumerate(intervals))
    return Node(small_table().nodes[0].squeeze, tuple(branches))


def widths_of(node: Node) -> list[int]:
    """Widths about every place where the decision may change, and some in between."""
    places = {0, 1, GRIPPER.empty_um}
    for branch in node.branches:
        places |= {branch.low_um, branch.expected_um, branch.high_um}
        places |= {(branch.expected_um + other.expected_um) // 2 for other in node.branches}
    return sorted({max(place + off, 0) for place in places for off in (-300, -1, 0, 1)})


OVERLAPPING = (
    node_of((20_000, 22_000, 30_000), (21_000, 28_000, 40_000)),
    node_of((20_000, 22_000, 60_000), (21_000, 28_000, 29_000)),  # one inside the other
    node_of((20_000, 21_000, 50_000), (21_000, 30_000, 45_000), (22_000, 44_000, 70_000)),
    node_of((5_000, 6_000, 7_000), (5_000, 6_374, 7_000), (5_000, 6_748, 7_000)),
    node_of((0, 85_000, 85_000)),
)


@pytest.mark.parametrize(
    "nodes",
    [*(table.nodes for table in TABLES), OVERLAPPING],
    ids=["small", "every field", "random", "120 nodes", "overlapping"],
)
def test_decide_at_every_node_width_and_flag_follows_the_rule(nodes):
    for node in nodes:
        decided = decision_map(node, GRIPPER)
        for width in widths_of(node):
            for flag in (False, True):
                assert decide(decided, width, flag) == slow_decision(node, width, flag)


@pytest.mark.parametrize("table", TABLES, ids=["small", "every field", "random", "120 nodes"])
def test_decision_map_of_valid_table_has_exactly_its_branches(table):
    dumps(table)  # validates it
    for node in table.nodes:
        decided = decision_map(node, table.gripper)
        numbers = set(range(len(node.branches)))
        assert {*decided.felt.branches, *decided.unfelt.branches} - {REJECT} == numbers
        assert set(by_count(decided)) - {REJECT} == numbers


def test_decide_flag_contradicting_width_rejects():
    nothing, grip = (0, 0, 900), (20_000, 21_000, 22_000)
    decided = decision_map(node_of(nothing, grip), GRIPPER)
    closed, held = 0, 21_000
    assert decide(decided, closed, felt=False) == 0
    assert decide(decided, held, felt=True) == 1
    assert decide(decided, held, felt=False) == REJECT  # wide, but nothing was felt
    assert decide(decided, closed, felt=True) == REJECT  # something felt where nothing fits
    assert decide(decision_map(node_of((0, 2_000, 4_000)), GRIPPER), closed, felt=True) == REJECT


@pytest.mark.parametrize("width", [-(10**9), -1, 85_001, 10**9])
def test_decide_width_outside_stroke_rejects(width):
    """A width outside the stroke is rejected even if the node's branches cover the whole stroke."""
    nothing, any_grip = (0, 0, 1_999), (2_000, 40_000, 85_000)
    for node in (small_table().nodes[0], node_of(nothing, any_grip)):
        decided = decision_map(node, GRIPPER)
        assert decide(decided, width, felt=True) == REJECT
        assert decide(decided, width, felt=False) == REJECT


def test_decide_grip_is_wide_or_above_zero_and_unfelt_up_to_5_mm():
    """TABLE.md: the object flag may miss a grip of up to 5 mm."""
    assert (HELD_UM, REJECT) == (2_000, -1)
    at = 1_900
    for low, expected, grip in ((0, 1_999, False), (0, 2_000, True), (1, 1_999, True)):
        decided = decision_map(node_of((low, expected, 2_500)), GRIPPER)
        assert (decide(decided, at, felt=True) == 0) == grip
        assert decide(decided, at, felt=False) == 0
    wide = decision_map(node_of((2_000, 6_000, 10_000)), GRIPPER)
    assert [decide(wide, width, False) for width in (5_000, 5_001)] == [0, REJECT]


def test_counted_um_equals_robotiq_line():
    # Robotiq SDK, units.cpp: opening_mm = 85 * (230 - gPO) / 227, clamped; 0.374 mm a count.
    for count in range(256):
        width_um = min(max(85e3 * (230 - count) / 227, 0), 85e3)
        assert LINE.width_um(GRIPPER.profile.counted_um(count)) == pytest.approx(width_um, abs=0.5)
    assert LINE.nearest_um(21_000) == GRIPPER.profile.counted_um(174)


FINE = replace(GRIPPER.profile, resolution_um=10.0, counts=None)


@pytest.mark.parametrize("profile", [GRIPPER.profile, FINE], ids=["2F-85", "0.01 mm"])
@pytest.mark.parametrize("points", [(), WORN.points_um], ids=["nominal", "worn"])
def test_calibration_gives_nearest_reading_and_least_opening(profile, points):
    calibration = Calibration(profile, points)
    readings = [profile.reading_um(step) for step in range(profile.steps + 1)]
    truly = {reading: calibration.width_um(reading) for reading in readings}
    assert list(truly.values()) == sorted(truly.values())
    for width in range(0, 90_000, 1_717):
        least = min(abs(true - width) for true in truly.values())
        assert abs(truly[calibration.nearest_um(width)] - width) == least
        above = [reading for reading, true in truly.items() if true >= width]
        assert calibration.opening_um(width) == (above or [profile.stroke_um])[0]
        within = any(width <= true <= width + 200 for true in truly.values())
        assert calibration.reads(width, width + 200) == within


FALLING = [((0, 0),), ((0, 0), (0, 5)), ((0, 5), (10, 4)), ((5, 0), (0, 9))]


@pytest.mark.parametrize("points", FALLING)
def test_calibration_of_points_that_do_not_rise_is_refused(points):
    with pytest.raises(TableError, match="calibration"):
        Calibration(GRIPPER.profile, points)
