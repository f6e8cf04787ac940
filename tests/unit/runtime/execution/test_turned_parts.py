"""A part whose plan is turned to the angle of the hand: its leaf and pose, its journal and its history."""

import base64
import json
from dataclasses import replace
from math import hypot, pi, remainder

import pytest
from audited_journals import Chain
from fake_cell import Deaf, FakeCell, fake_cell
from sample_tables import small_table, with_job
from squeezes import AT_21, AT_30, arm_moves, run

from runtime.execution.delivery import Delivery
from runtime.execution.executor import Executor, RunOptions
from runtime.journal.replay import Replay
from runtime.spc import history
from runtime.table import Table, dumps, predicted_pose
from runtime.traversal.results import PartResult


def unknown() -> Table:
    """The small table with a job whose part may lie at any angle."""
    job = {
        "gripper": {"upper_finger_share": 0.5},
        "uncertainty": {"radius_mm": 10.0, "orientation_halfwidth_deg": 180.0},
    }
    return with_job(small_table(), json.dumps(job))


def located(table: Table, angle_rad: float, options: RunOptions | None = None):
    """The cell and the result of a part located by two squeezes, with the hand first at `angle_rad`."""
    rig = fake_cell([AT_30, AT_21])
    rig.arm.at = (*rig.arm.at[:3], angle_rad)
    return rig, run(rig, options or RunOptions(), table)


def angles(rig: FakeCell) -> list[float]:
    return [target[3] for target in arm_moves(rig)]


def turns(rig: FakeCell) -> list[int]:
    return [fields["turn_urad"] for kind, fields in rig.journal.kept if kind == "turned"]


def from_hand(result: PartResult, table: Table) -> tuple[float, float, float]:
    """Distance [mm] and angle [rad] of the stated pose from the last squeeze, and the number of the leaf.

    The angle is modulo half a turn.
    """
    leaf, hand = result.leaf_of(table), result.steps[-1].squeeze
    assert leaf is not None
    x, y, theta = predicted_pose(leaf)
    apart = hypot(x - hand.x_um / 1e3, y - hand.y_um / 1e3)
    return apart, remainder(theta - hand.angle_urad / 1e6, pi), float(result.leaf or 0)


@pytest.mark.parametrize("angle_rad", [-2.5, 0.1, 1.3])
def test_executor_unknown_orientation_starts_at_angle_of_hand(angle_rad) -> None:
    table = unknown()
    rig, result = located(table, angle_rad)
    _, plain = located(table, angle_rad, RunOptions(turns=False))
    first = [angle for angle in angles(rig) if abs(angle - angle_rad) < 1e-5]
    assert angles(rig)[: len(first)] == first
    assert len(first) >= 3  # up, above the part, down
    assert result.turn_urad == turns(rig)[0]
    assert from_hand(result, table) == pytest.approx(from_hand(plain, table), abs=2e-3)
    assert plain.turn_urad == 0


def test_executor_plan_at_angle_of_hand_is_not_turned() -> None:
    rig, result = located(unknown(), 0.0)
    assert turns(rig) == []
    assert result.turn_urad == 0


@pytest.mark.parametrize(
    ("table", "options", "wrist"),
    [
        (small_table(), RunOptions(), (-10.0, 10.0)),
        (unknown(), RunOptions(turns=False), (-10.0, 10.0)),
        (unknown(), RunOptions(delivery=Delivery(drop=(20.0, -15.0, 0.7))), (-10.0, 10.0)),
        (unknown(), RunOptions(), (-2.0, 4.0)),
    ],
    ids=["stripped", "person", "delivery", "wrist"],
)
def test_executor_plan_is_not_turned_where_cell_forbids(table, options, wrist) -> None:
    rig = fake_cell([AT_21, AT_21])
    rig.arm.at, rig.arm.turns = (*rig.arm.at[:3], 1.3), wrist
    assert run(rig, options, table).turn_urad == 0
    assert turns(rig) == []


@pytest.mark.parametrize("angle_rad", [-4.6, -1.0, 4.6])
def test_executor_turned_plan_stays_within_wrist_range(angle_rad) -> None:
    rig = fake_cell([AT_30, AT_21])
    rig.arm.at, rig.arm.turns = (*rig.arm.at[:3], angle_rad), (-1.5 * pi, 1.5 * pi)
    assert run(rig, RunOptions(), unknown()).leaf == 1
    assert all(abs(angle) <= 1.5 * pi for angle in angles(rig))


def test_executor_resumed_part_keeps_turn() -> None:
    table = unknown()
    rig, result = located(table, 1.3)
    header = {"kind": "header", "table_base64": base64.b64encode(dumps(table)).decode(), "seq": 0}
    kept = [{"kind": kind, "seq": 1, **fields} for kind, fields in rig.journal.kept]
    replay = Replay()
    cut = next(number for number, entry in enumerate(kept) if entry["kind"] == "placed")
    assert list(replay.follow([header, *kept[:cut]])) == []
    again = fake_cell([AT_30, AT_21])
    again.arm.at = (0.0, 0.0, 60.0, -0.4)
    resumed = Executor(table, again.cell, Deaf()).run_part(1, replay)
    assert [step.squeeze for step in resumed.steps] == [step.squeeze for step in result.steps]
    assert resumed.leaf_of(table) == result.leaf_of(table)


def test_history_read_turned_part_is_in_frame_of_plan(tmp_path) -> None:
    path, turn_urad = tmp_path / "journal.jsonl", 1_570_796
    with Chain(path) as journal:
        journal.header(unknown())
        journal.record("part", {"part": 1})
        journal.record("turned", {"part": 1, "turn_urad": turn_urad})
        off = {"residual_x_mm": -0.2, "residual_y_mm": 0.1, "residual_theta_rad": 0.01}
        journal.record("audit", {"part": 1, "verdict": "pass", **off})
        journal.record("outcome", {"part": 1, "outcome": "leaf", "leaf": 0})
        true = {"x_um": -700, "y_um": 100, "theta_urad": turn_urad + 10_000}
        journal.record("truth", {"part": 1, **true, "within_goal": True})
    (part,) = history.read([path]).parts
    assert part.residual == pytest.approx((0.1, 0.2, 0.01), abs=1e-5)
    assert part.true == pytest.approx((0.1, 0.7, 0.01), abs=1e-5)  # the leaf is at (0, 0.5), 0 deg


def test_journal_squeezes_of_turned_part_are_in_world_frame() -> None:
    rig, result = located(unknown(), 1.3)
    squeezes = [fields for kind, fields in rig.journal.kept if kind == "squeeze"]
    stated = [fields["angle_urad"] for fields in squeezes]
    assert stated == [step.squeeze.angle_urad for step in result.steps]
    assert abs(remainder(squeezes[0]["angle_urad"] / 1e6 - 1.3, pi)) < 1e-5
    assert replace(result, turn_urad=0).leaf_of(small_table()) == small_table().leaves[1]
