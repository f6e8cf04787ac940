"""The hand while one part is located: gentle force, motions between squeezes, drags, and a displaced arm."""

import math

import pytest
from counting import SETTINGS, width_um
from fake_cell import State, fake_cell
from sample_tables import changed, small_table, with_job
from squeezes import AT_21, AT_30, AT_36, AT_60, arm_moves, jaw_moves, meeting, run

from runtime.errors import GripperStateError
from runtime.execution.executor import RunOptions
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.table import Place, Table
from runtime.traversal.results import Outcome

# -- force ----------------------------------------------------------------------------------------


def dragging_table(force_mn: int) -> Table:
    """The small table with a drag after its root, whose squeeze states the force `force_mn` [mN].

    The hand drags a part only when the jaws hold it with all of this force.
    """
    force = {"nodes.0.squeeze.force_mn": force_mn, "limits.max_force_mn": 235_000}
    return changed(small_table(), {"nodes.0.release": Place(12_000, -7_000), **force})


@pytest.mark.parametrize(("grip_current_ma", "raises"), [(None, 4), (299, 0), (300, 0), (301, 4)])
def test_hand_raises_force_until_current_reaches_limit(grip_current_ma, raises):
    rig = fake_cell([AT_21])
    handling = Handling(regulated=True, grip_current_ma=grip_current_ma)
    assert run(rig, RunOptions(handling=handling), dragging_table(200_000)).leaf == 0
    closings = [force for position, _, force in jaw_moves(rig) if position == 255]
    assert len(closings) == 1 + raises


# -- short squeezes ---------------------------------------------------------------------------------


def known_table() -> Table:
    """The small table with a job: the part is 16 mm high, and the second squeeze opens to 50 mm."""
    job = '{"gripper":{"upper_finger_share":0.5},"part":{"height_mm":16.0}}'
    table = with_job(small_table(), job)
    return changed(table, {"nodes.1.contact_um": 42_000, "nodes.1.squeeze.opening_um": 50_000})


def test_hand_between_squeezes_rises_above_part_and_opens_for_next():
    rig = fake_cell([AT_30, AT_21])
    assert run(rig, RunOptions(), known_table()).leaf == 1
    heights = [target[2] for target in arm_moves(rig)]
    assert heights == [60.0, 60.0, 10.0, 20.0, 20.0, 10.0, 60.0]
    opened = [width_um(position) for position, *_ in jaw_moves(rig) if position < 255]
    assert [width >= 50_000 for width in opened] == [True] * len(opened)
    assert min(opened) < 51_000
    assert opened[-1] == 85_000  # for the next part


def test_hand_frees_jaws_before_rising_to_narrower_opening():
    rig = fake_cell([AT_36, AT_21])
    narrow = {"nodes.1.contact_um": None, "nodes.1.squeeze.opening_um": 38_000}
    widths = {"low_um": 35_000, "expected_um": 36_000, "high_um": 37_000}
    wide = {f"nodes.0.branches.1.{name}": each for name, each in widths.items()}
    table = changed(known_table(), narrow | wide)
    run(rig, RunOptions(), table)
    log = rig.log.calls
    rises = (call.name == "move_linear" and call.arguments[2] == 20.0 for call in log)
    rise = [*rises].index(True)
    before = [call.arguments[0] for call in log[:rise] if call.name == "move"]
    assert width_um(before[-1]) >= 40_500
    after = [call.arguments[0] for call in log[rise:] if call.name == "move"]
    assert 38_000 <= width_um(after[0]) < 39_000


@pytest.mark.parametrize(
    ("angle_rad", "wrist", "expected_rad"),
    [
        (1.4, (-10.0, 10.0), 1.4),
        (3.0, (-10.0, 10.0), 3.0),
        (3.0, (-2.0, 2.0), 3.0 - math.pi),
        (1.4, (-2.0, 1.0), 1.4 - math.pi),
        (2.5, (-4.5, 2.0), 2.5 - math.pi),  # the long way round leads to 2.5 - tau
        (1.4, (-8.0, 1.5), 1.4 - math.pi),  # near the end of the range the way back counts less
        (0.5, (-8.0, 1.5), 0.5),
        (1.5, (-8.0, 5.0), 1.5),  # in the inner half of the range
        (1.4, (-math.inf, math.inf), 1.4),
    ],
)
def test_hand_with_even_fingers_turns_back_only_near_end_of_wrist(angle_rad, wrist, expected_rad):
    assert _turned_to(angle_rad, wrist, known_table()) == pytest.approx(expected_rad, abs=1e-6)


@pytest.mark.parametrize(("angle_rad", "wrist"), [(3.0, (-10.0, 10.0)), (1.4, (-8.0, 1.5))])
def test_hand_with_uneven_fingers_turns_to_angle_itself(angle_rad, wrist):
    uneven = with_job(known_table(), '{"gripper": {"upper_finger_share": 0.6}}')
    assert _turned_to(angle_rad, wrist, uneven) == pytest.approx(angle_rad, abs=1e-6)


def test_hand_turned_back_stays_half_turn_off_for_rest_of_part():
    rig = fake_cell([])
    rig.arm.at, rig.arm.turns = (0.0, 0.0, 60.0, 0.0), (-8.0, 1.5)
    hand = Hand(rig.gripper, rig.arm, rig.cell.clock, known_table(), Handling())
    angles = []
    for number, angle_rad in enumerate([0.1, 1.4, 1.1]):
        angles.append(hand.turn_to(0.0, 0.0, angle_rad, first=number == 0))
        rig.arm.at = (0.0, 0.0, 60.0, angles[-1])
        hand._sent_to = None
    assert angles == pytest.approx([0.1, 1.4 - math.pi, 1.1 - math.pi])


def _turned_to(angle_rad: float, wrist: tuple[float, float], table: Table) -> float:
    """Angle that the hand takes for a second squeeze planned at `angle_rad`, after a first one at 0 rad."""
    rig = fake_cell([AT_30, AT_21])
    rig.arm.turns = wrist
    turned = changed(table, {"nodes.1.squeeze.angle_urad": round(1e6 * angle_rad)})
    assert run(rig, RunOptions(), turned).leaf == 1
    return arm_moves(rig)[-1][3]


@pytest.mark.parametrize(
    ("streams", "calls"), [(True, ["move", "move"]), (False, ["move", "wait", "move"])]
)
def test_hand_waits_between_strokes_unless_gripper_streams(streams, calls):
    fast = {"nodes.0.contact_um": 33_000, "limits.max_speed_um_s": 150_000}
    table = changed(small_table(), {**fast, "gripper.streams": streams})
    rig = fake_cell([AT_21])
    assert run(rig, RunOptions(), table).leaf == 0
    seen = [call.name for call in rig.log.calls if call.name in ("move", "wait")]
    assert seen[2 : 2 + len(calls)] == calls


# -- drags ----------------------------------------------------------------------------------------


def test_hand_drags_held_part_to_release_point_and_opens():
    table = changed(small_table(), {"nodes.0.release": Place(12_000, -7_000)})
    rig = fake_cell([AT_21])
    rig.arm.at = (5.0, 5.0, 60.0, 0.1)
    assert run(rig, RunOptions(), table).leaf == 0
    motions = [target[:4] for target in arm_moves(rig)]
    assert motions[-2:] == [(12.0, -7.0, 10.0, 0.0), (12.0, -7.0, 60.0, 0.0)]
    names = [call.name for call in rig.log.calls if call.name in ("move", "move_linear")]
    assert names[-3:] == ["move_linear", "move", "move_linear"]
    rejected = fake_cell([AT_36])
    run(rejected, RunOptions(), table)
    assert (12.0, -7.0) not in {target[:2] for target in arm_moves(rejected)}


# -- faults and times -----------------------------------------------------------------------------


def test_await_stillness_of_moving_gripper_times_out():
    rig = fake_cell([])
    rig.gripper.now = State(moving=True)
    hand = Hand(rig.gripper, rig.arm, rig.cell.clock, small_table(), Handling())
    with pytest.raises(GripperStateError, match="without having been asked"):
        hand.await_stillness()
    assert rig.cell.clock.now() >= 8.0


@pytest.mark.parametrize("request_counts", [255, 0], ids=["closing", "before opening"])
@pytest.mark.parametrize(
    "by",
    [(0.6, 0.0, 0.0, 0.0), (0.0, 0.0, 5.0, 0.0), (0.0, 0.0, 0.0, 0.02), (0.0, 0.0, 0.0, math.pi)],
)
def test_executor_displaced_arm_in_squeeze_is_fault_and_not_moved(request_counts, by):
    rig = fake_cell([AT_21])
    move = rig.gripper.move

    def bump(width_um, speed_mm_s, force_n):
        squeezes = width_um < 0 or rig.gripper.gripping
        move(width_um, speed_mm_s, force_n)
        if squeezes and (width_um < 0) == (request_counts == 255):
            rig.arm.at = tuple(a + b for a, b in zip(rig.arm.at, by, strict=True))
            rig.log.call("test", "bump")

    rig.gripper.move = bump
    result = run(rig, RunOptions())
    assert (result.outcome, result.exit_code, result.leaf) == (Outcome.FAULT, 20, None)
    assert "off the place it was sent to" in str(result.reason)
    after = rig.log.calls[rig.log.calls.index(rig.log.named("bump")[0]) :]
    assert "stop" in [call.name for call in after]
    assert "move_linear" not in [call.name for call in after]
    assert result.safe_state[1] == "arm not moved: state unknown"


@pytest.mark.parametrize("turn_rad", [0.0, 0.009, -0.009])
def test_executor_arm_within_tolerance_is_no_fault(turn_rad):
    rig = fake_cell([AT_21])
    move_linear = rig.arm.move_linear

    def settle(*target):
        move_linear(*target)
        x, y, z, angle = rig.arm.at
        rig.arm.at = (x + 0.3, y - 0.3, z + 0.2, angle + turn_rad)

    rig.arm.move_linear = settle
    assert run(rig, RunOptions()).leaf == 0


def test_executor_regulated_unplanned_width_raises_force():
    rig = meeting(AT_60[0])
    result = run(rig, RunOptions(handling=Handling(regulated=True)))
    assert result.outcome is Outcome.REJECT  # no branch holds 60 mm
    forces = [force for position, _, force in jaw_moves(rig) if position > 0]
    assert forces == [0, SETTINGS.force(40.0)]


def test_executor_phases_sum_to_seconds_of_part():
    rig = fake_cell([AT_30, AT_21])
    rig.cell.clock.step_s = 0.001
    result = run(rig, RunOptions())
    assert len(result.phases) == 2
    assert sum(phases.total_s for phases in result.phases) == pytest.approx(result.seconds, abs=0.1)
    assert rig.journal.kept[-1][1]["phases"][0].keys() == result.phases[0]._asdict().keys()
