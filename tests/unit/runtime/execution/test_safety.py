"""Targets that are refused before they are sent, the place where a motion must end, and the safe state."""

import math
from dataclasses import replace

import pytest
from fake_cell import Log, fake_cell
from refusals import refusal
from sample_tables import small_table

from runtime.errors import MotionRefusedError, TableError
from runtime.execution import safety
from runtime.execution.safe_state import reach_safe_state
from runtime.table import GripperSpec, profile_of

LIMITS = small_table().limits
X_MIN, Y_MIN, X_MAX, Y_MAX = (edge / 1000 for edge in LIMITS.work_area_um)
LOW, HIGH = LIMITS.squeeze_height_um / 1000, LIMITS.retreat_height_um / 1000
INSIDE = (0.0, 0.0, (LOW + HIGH) / 2, 0.3)


def but(**changed: float) -> tuple[float, float, float, float]:
    """A pose inside the limits (x, y, z, angle), with the named values replaced."""
    x, y, z, angle = (changed.get(name, value) for name, value in zip("xyza", INSIDE, strict=True))
    return x, y, z, angle


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (INSIDE, ""),
        (but(x=X_MIN, y=Y_MIN, z=LOW, a=-3 * math.tau), ""),
        (but(x=X_MAX, y=Y_MAX, z=HIGH, a=3 * math.tau), ""),
        *((but(x=edge), "outside the work area") for edge in (X_MAX + 0.01, X_MIN - 0.01)),
        *((but(y=edge), "outside the work area") for edge in (Y_MAX + 0.01, Y_MIN - 0.01)),
        *((but(z=height), "height") for height in (LOW - 0.01, HIGH + 0.01)),
        *((but(a=side * (3 * math.tau + 0.01)), "whole turns") for side in (1, -1)),
        *((but(**{name: bad}), "no place") for name in "xyza" for bad in (math.nan, math.inf)),
    ],
)
def test_check_target_beyond_limits_is_refused(pose, message):
    with refusal(MotionRefusedError, message, unless=not message):
        safety.check_target(pose, LIMITS)


def test_check_placed_allows_whole_turn_and_refuses_small_angle():
    arm = fake_cell([]).arm
    arm.at = but(a=0.3 - math.tau)
    safety.check_placed(arm, INSIDE)
    arm.at = but(a=0.311)
    with pytest.raises(MotionRefusedError):
        safety.check_placed(arm, INSIDE)


@pytest.mark.parametrize("arm_known", [True, False])
@pytest.mark.parametrize("fail_at", range(-1, 5))
def test_reach_safe_state_any_failure_moves_no_unknown_arm(arm_known, fail_at):
    rig = fake_cell([], Log(fail_at, ConnectionError("gone")))
    notes = reach_safe_state(rig.gripper, rig.arm, LIMITS, arm_known=arm_known)
    assert len(notes) == 2
    assert rig.log.calls[0].name == "stop"
    assert bool(rig.log.named("pose")) == arm_known
    assert ("NOT KNOWN" in notes[0]) == (fail_at in (0, 1))
    for call in rig.log.named("move_linear"):
        assert arm_known
        assert call.arguments[:2] == rig.arm.at[:2]
        assert call.arguments[2] == HIGH


def test_reach_safe_state_arm_above_retreat_height_stays():
    rig = fake_cell([])
    rig.arm.at = but(z=HIGH + 1.0)
    reach_safe_state(rig.gripper, rig.arm, LIMITS, arm_known=True)
    assert rig.log.named("move_linear") == []


@pytest.mark.parametrize(
    ("model", "speed_mm_s", "force_n", "message"),
    [
        ("robotiq-2f-85", 150, 235, ""),
        ("robotiq-2f-85", 151, 40, r"closes at 151 mm/s; the gripper does 20..150"),
        ("robotiq-2f-140", 250, 10, ""),
        ("robotiq-2f-140", 29, 40, r"closes at 29 mm/s; the gripper does 30..250"),
        ("robotiq-2f-140", 60, 126, r"squeezes with 126 N; the gripper does 10..125"),
        ("hand-e", 20, 185, ""),
        ("hand-e", 20, 186, r"squeezes with 186 N; the gripper does 20..185"),
    ],
)
def test_check_table_beyond_gripper_is_refused(model, speed_mm_s, force_n, message):
    table = small_table()
    asked = {"speed_um_s": 1000 * speed_mm_s, "force_mn": 1000 * force_n}
    nodes = tuple(node._replace(squeeze=node.squeeze._replace(**asked)) for node in table.nodes)
    table = replace(table, nodes=nodes, gripper=GripperSpec.of(profile_of(model), 27_500, 9_500))
    with refusal(TableError, message, unless=not message):
        safety.check_table(table)
