"""Turned plans: turning back restores the plan, distances stay, and some plans may not be turned."""

from dataclasses import replace
from math import hypot, pi

import pytest
from sample_tables import changed, every_field_table, pushing_table, random_table, small_table

from runtime.table import Area, Place, Schedule, Squeezed, Table, may_turn, turned

UNKNOWN = {"uncertainty": {"radius_mm": 10.0, "orientation_halfwidth_deg": 180.0}}
TURNS_URAD = [1, 785_398, -1_570_796, 3_141_592, 5_000_000]


def numbers(table: Table) -> list[int]:
    """Places [um] and angles [urad] of all nodes and leaves."""
    result: list[int] = []
    for node in table.nodes:
        result += [*node.squeeze.place, node.squeeze.angle_urad, *(node.release or ())]
    for leaf in table.leaves:
        result += [number for pose in leaf.poses for number in pose[:3]]
    return result


@pytest.mark.parametrize("turn_urad", TURNS_URAD)
@pytest.mark.parametrize("table", [every_field_table(), random_table(3, 12)], ids=["all", "random"])
def test_turned_and_turned_back_restores_plan(table: Table, turn_urad: int) -> None:
    back = turned(turned(table, turn_urad), -turn_urad)
    assert numbers(back) == pytest.approx(numbers(table), abs=2)
    for leaf, before in zip(back.leaves, table.leaves, strict=True):
        assert leaf.covariance == pytest.approx(before.covariance, abs=2)
    kept = replace(back, nodes=table.nodes, leaves=table.leaves)
    assert kept == table
    assert [node.branches for node in back.nodes] == [node.branches for node in table.nodes]


@pytest.mark.parametrize("turn_urad", TURNS_URAD)
def test_turned_keeps_distances_between_hand_and_part(turn_urad: int) -> None:
    table = every_field_table()
    result = turned(table, turn_urad)
    for node, before in zip(result.nodes, table.nodes, strict=True):
        for leaf, leaf_before in zip(result.leaves, table.leaves, strict=True):
            apart, apart_before = (
                hypot(one.squeeze.x_um - end.x_um, one.squeeze.y_um - end.y_um)
                for one, end in ((node, leaf), (before, leaf_before))
            )
            assert apart == pytest.approx(apart_before, abs=2)
            off = leaf.theta_urad - node.squeeze.angle_urad
            off -= leaf_before.theta_urad - before.squeeze.angle_urad
            assert 1e6 * 2 * pi * round(off / (2e6 * pi)) == pytest.approx(off, abs=2)


AWAY = {"nodes.0.release": Place(55_000, 55_000)}  # in the work area, but not at every turn
TIGHT = {"limits.work_area_um": Area(-60_000, -2_100, 60_000, 60_000)}


@pytest.mark.parametrize(
    ("table", "job", "middle_mm"),
    [
        (small_table(), None, 0.0),
        (small_table(), {}, 0.0),
        (small_table(), {"uncertainty": {"orientation_halfwidth_deg": 179.0}}, 0.0),
        (changed(small_table(), {"goal.kind": "tolerances"}), UNKNOWN, 0.0),
        (changed(small_table(), {"goal.kind": "modes"}), UNKNOWN, 0.0),
        (pushing_table(), UNKNOWN, 0.0),
        (changed(small_table(), AWAY), UNKNOWN, 0.0),
        (changed(small_table(), TIGHT), UNKNOWN, 0.0),
        (small_table(), UNKNOWN, 58.0),
    ],
)
def test_may_turn_where_direction_matters_is_false(
    table: Table, job: dict | None, middle_mm: float
) -> None:
    assert may_turn(small_table(), UNKNOWN)
    assert not may_turn(table, job, middle_mm)


@pytest.mark.parametrize("share", [0.5, 0.6])
@pytest.mark.parametrize("angle_rad", [-2.0, 0.7, 4.0])
def test_schedule_of_turned_plan_starts_without_turning_hand(
    share: float, angle_rad: float
) -> None:
    job = {"gripper": {"upper_finger_share": share}}
    parts = [
        Schedule.of(small_table(), each).part([Squeezed(0, 21.0, 0)], (0.0, 0.0, angle_rad))
        for each in (job, {**job, **UNKNOWN})
    ]
    assert parts[1][0].travel_s < parts[0][0].travel_s
    assert parts[1][0].travel_s == Schedule.of(small_table(), job).timing.poll_s
