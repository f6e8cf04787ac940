"""What only the open_abb driver does: frames, turns of the wrist, and settings that another client left.

The contract of every arm is tested in tests/contract/test_arm_contract.py.
"""

import contextlib
import math
import time

import pytest
from arm_rigs import BASE, SCALE, Abb
from impostor import Impostor

from drivers import connect
from drivers.abb import arm as abb_arm
from drivers.abb.codec import Pose
from drivers.errors import ArmError, PortError
from drivers.sim.devices.arm import Answer, ArmModel


@pytest.fixture
def rig():
    with contextlib.closing(Abb()) as result:
        yield result


@pytest.fixture
def impatient(monkeypatch):
    """Shorten both time limits of an answer: that of a real controller, and that of a simulated one."""
    monkeypatch.setattr(abb_arm, "ANSWER_S", 0.4)
    monkeypatch.setattr(abb_arm, "STARVED_S", 0.4)


def test_arm_opened_without_tool_drops_that_of_last_client(rig):
    with rig.open(tool=Pose(0.0, 0.0, 120.0, (1.0, 0.0, 0.0, 0.0))) as arm:
        assert arm.pose().z_mm == pytest.approx(-20.0)
        arm.move_linear((10.0, 0.0, 10.0, 0.0), 50.0)
    with rig.open() as arm:
        assert arm.pose().z_mm == pytest.approx(130.0)


@pytest.mark.usefixtures("impatient")
def test_arm_after_silence_refuses_pose_and_move(rig):
    with rig.open() as arm:
        with pytest.raises(ArmError, match="silence"):
            arm.move_linear((900.0, 0.0, 50.0, 0.0), 5000.0)
        for call in (arm.pose, lambda: arm.move_linear((0.0, 0.0, 50.0, 0.0), 100.0)):
            with pytest.raises(ArmError, match="state unknown since"):
                call()
    assert rig.model.moves == 0


def test_arm_whole_turns_are_counted_from_joints(rig):
    with rig.open(base=BASE) as arm:
        began = rig.model.joints_at(1e9)[5]
        for number in range(1, 5):
            arm.move_linear((0.0, 0.0, 60.0, number * math.pi / 2.0), 500.0)
        assert rig.model.joints_at(1e9)[5] == pytest.approx(began - 360.0)
        assert arm.pose().angle_rad == pytest.approx(2.0 * math.pi, abs=0.003)
        low, high = arm.turn_range(0.0, 0.0)
        assert (math.degrees(low), math.degrees(high)) == pytest.approx((-210.0, 570.0), abs=0.1)
    with rig.open(base=BASE) as arm:  # another client counts the same
        assert arm.pose().angle_rad == pytest.approx(2.0 * math.pi, abs=0.003)
        assert arm.turn_range(0.0, 0.0) == pytest.approx((low, high), abs=0.003)


@pytest.mark.parametrize("way", [-1, 1])
def test_move_linear_beyond_wrist_range_is_not_sent(rig, way):
    with rig.open(base=BASE) as arm:
        turned = 0.0
        with pytest.raises(ArmError, match=r"not moved.*farther round than the wrist turns"):  # noqa: PT012
            while abs(turned) < 1200.0:
                arm.move_linear((0.0, 0.0, 50.0, math.radians(turned + 60.0 * way)), 500.0)
                turned += 60.0 * way
        assert (turned, rig.model.halted) == (-180.0 if way < 0 else 540.0, "")
        arm.move_linear((0.0, 0.0, 50.0, math.radians(turned - 60.0 * way)), 500.0)


@pytest.mark.parametrize("angle_deg", [-175.0, 180.0, 350.0])
def test_move_linear_by_half_a_turn_is_refused(rig, angle_deg):
    with rig.open(base=BASE) as arm, pytest.raises(ArmError, match="either way"):
        arm.move_linear((0.0, 0.0, 50.0, math.radians(angle_deg)), 500.0)
    assert rig.moves == 0


def test_arm_wrist_beyond_narrowed_range_may_only_turn_back(rig):
    url = f"{rig.url}?base=-300,0,0&wrist=-90,90"
    with contextlib.closing(connect.arm(url, time_scale=SCALE)) as arm:
        low, high = arm.turn_range(0.0, 0.0)  # axis 6 stands at 180 deg
        assert (math.degrees(low), math.degrees(high)) == pytest.approx((100.0, 260.0), abs=0.1)
        arm.move_linear((0.0, 0.0, 60.0, 0.0), 500.0)
        with pytest.raises(ArmError, match="not moved"):
            arm.move_linear((0.0, 0.0, 60.0, -0.1), 500.0)
        arm.move_linear((0.0, 0.0, 60.0, 1.0), 500.0)


def test_turn_range_wrist_turned_by_another_client_is_refused(rig):
    with rig.open(base=BASE) as arm:
        arm.move_linear((0.0, 0.0, 60.0, 0.5), 500.0)
        *others, wrist = rig.model.joints_at(rig.now())
        message = " ".join(f"{joint:.4f}" for joint in (*others, wrist - 360.0))
        rig.model.execute(f"2 {message} #", rig.now())
        time.sleep(2.0 / SCALE)
        with pytest.raises(ArmError, match="whole turns off"):
            arm.turn_range(0.0, 0.0)


def test_arm_model_wrist_beyond_its_end_halts_without_answer():
    model = ArmModel(BASE)
    number, answer = 0, Answer("", 0.0)
    while not model.halted:
        number += 1
        w, x = math.cos(math.radians(50.0 * number)), math.sin(math.radians(50.0 * number))
        answer = model.execute(f"1 0 0 60 0 {w:.6f} {x:.6f} 0 #", 100.0 * number)
    assert (answer.text, model.halted) == (None, "50027 joint out of range")


def test_pose_after_interrupted_move_waits_for_its_end(rig):
    with rig.open() as arm:
        arm.move_linear((0.0, 0.0, 99.0, 0.0), 20.0)
        receive = arm._link.receive

        def interrupt(seconds):
            arm._link.receive = receive
            raise KeyboardInterrupt

        arm._link.receive = interrupt
        with pytest.raises(KeyboardInterrupt):
            arm.move_linear((100.0, 0.0, 100.0, 0.0), 20.0)
        assert arm.pose().x_mm == pytest.approx(100.0)


def stopped(arm, times):
    """Makes the link miss its deadline in the next `times` waits, as if this process were stopped."""
    receive = arm._link.receive

    def waited(seconds):
        nonlocal times
        if seconds < 0.1 or not times:
            return receive(seconds)
        times -= 1
        time.sleep(seconds + 0.02)
        return b""

    arm._link.receive = waited


@pytest.mark.usefixtures("impatient")
def test_move_linear_process_stopped_meanwhile_completes(rig):
    with rig.open() as arm:
        arm.pose()
        stopped(arm, 2)  # for the speed's answer, and for the move's
        arm.move_linear((10.0, 0.0, 100.0, 0.0), 50.0)
        assert arm.pose().x_mm == pytest.approx(10.0)


@pytest.mark.usefixtures("impatient")
def test_pose_process_stopped_meanwhile_is_asked_for_once_more(rig):
    with rig.open() as arm:
        stopped(arm, 1)
        assert arm.pose().z_mm == pytest.approx(100.0)
        stopped(arm, 2)
        with pytest.raises(ArmError, match="answered, but this process was stopped or starved"):
            arm.pose()
        assert arm.pose().z_mm == pytest.approx(100.0)


def test_connect_arm_frames_and_limits_in_url_are_applied(rig):
    query = "?tool=0,0,120&work_object=20,0,10,1,0,0,0&base=-300,0,0&area=-50,-50,-500,50,50,90"
    with contextlib.closing(connect.arm(rig.url + query, time_scale=SCALE)) as arm:
        assert arm.pose()[:3] == pytest.approx((-20.0, 0.0, -30.0))
        arm.move_linear((0.0, 0.0, 0.0, 0.0), 500.0)
        with pytest.raises(ArmError, match="outside the work area"):
            arm.move_linear((0.0, 51.0, 0.0, 0.0), 500.0)
        assert rig.moves == 1
        assert rig.model.pose_at(1e9)[2] == pytest.approx(0.0)


def test_move_linear_path_out_of_reach_is_refused(rig):
    """Both ends are in reach, but the line between them passes through the base of the arm."""
    with rig.open(base=BASE, work_object=BASE) as arm:
        arm.move_linear((250.0, 250.0, 100.0, 0.0), 1000.0)
        with pytest.raises(ArmError, match="out of the arm's reach"):
            arm.move_linear((-250.0, -250.0, 100.0, 0.0), 1000.0)
        arm.move_linear((250.0, -250.0, 100.0, 0.0), 1000.0)


@pytest.mark.parametrize(
    "url",
    [
        *("tcp://127.0.0.1:1", "tcp://127.0.0.1", "rtu+tcp://127.0.0.1:5000", "x"),
        *(f"tcp://127.0.0.1:5000?{query}" for query in ("base=1,2", "area=1,2,3", "tool=x")),
    ],
)
def test_connect_arm_malformed_or_unserved_url_is_refused(url):
    with pytest.raises(PortError):
        connect.arm(url)


@pytest.mark.parametrize(
    ("impostor", "message"),
    [
        ({"answer": b"HTTP/1.1 400 Bad Request"}, "does not fit"),
        ({"answer": b"0 0 "}, "bad message"),
        ({"answer": b"0 1 "}, "does not fit|silence"),  # also to SET_TOOL: the echoed code counts
        ({"answer": b"0 1 0 1 "}, "does not fit"),
        ({"answers": 0}, "connection broke"),  # the driver tries once more, then gives up
    ],
)
@pytest.mark.usefixtures("impatient")
def test_connect_arm_server_other_than_open_abb_is_refused(impostor, message):
    with contextlib.closing(Impostor(**impostor)) as other, pytest.raises(ArmError, match=message):
        connect.arm(f"tcp://{other.address}", time_scale=SCALE)


def test_move_linear_radius_sets_turn_speed_and_zero_is_refused(rig):
    with rig.open(base=BASE) as arm:
        for radius_mm in (80.0, 160.0):
            arm.move_linear((0.0, 0.0, 60.0, 0.5 - radius_mm / 400.0), 100.0, radius_mm)
            line_mm_s, turn_deg_s = rig.model._speed
            assert line_mm_s == pytest.approx(100.0)
            assert math.radians(turn_deg_s) * radius_mm == pytest.approx(100.0, rel=1e-4)
        with pytest.raises(ArmError, match="positive"):
            arm.move_linear((0.0, 0.0, 60.0, 0.0), 100.0, 0.0)
