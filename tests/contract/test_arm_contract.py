"""What every arm must do (drivers/ports.py), run against each make; and what open_abb asks for besides."""

import contextlib
import math
import random
import socket
import threading
import time

import other_make
import pytest

from drivers import connect, ports
from drivers.abb.codec import Pose, hand_angle
from drivers.errors import ArmError, PortError, ReadOnlyError
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.devices.arm_server import ArmServer
from drivers.sim.wire.serving import SimulatedTime

SCALE = 40.0
BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


def opened(url, read_only, frames):
    """An arm whose frames are told in its address."""
    told = (f"{name}={','.join(map(str, (*pose[:3], *pose[3])))}" for name, pose in frames.items())
    query = f"?{'&'.join(told)}" if frames else ""
    return contextlib.closing(connect.arm(url + query, time_scale=SCALE, read_only=read_only))


class Abb:
    """The open_abb driver and its simulated server."""

    far_mm = 900.0

    def __init__(self):
        self.model = ArmModel(BASE)
        time = SimulatedTime(SCALE, threading.Event())
        self.now = time.now
        self.server = ArmServer(self.model, threading.RLock(), time)
        self.server.start()

    @property
    def url(self):
        return self.server.url

    @property
    def moves(self):
        return self.model.moves

    def truth(self):
        x, y, z, rotation = self.model.pose_at(self.now())
        return (x, y, z, hand_angle(rotation))

    def silence(self):
        self.model.execute = lambda text, now: Answer(None, math.inf)

    def open(self, *, read_only=False, **frames):
        return opened(self.url, read_only, frames)

    def close(self):
        self.server.close()


class Other:
    """An arm of another make."""

    far_mm = 900.0

    def __init__(self):
        self.device = other_make.ArmDevice(SCALE)
        self.server = other_make.Server(self.device.answer)
        self.url = f"other://127.0.0.1:{self.server.port}"

    @property
    def moves(self):
        return self.device.moves

    def truth(self):
        return self.device.place

    def silence(self):
        self.device.mute = True

    def open(self, *, read_only=False, **frames):
        return opened(self.url, read_only, frames)

    def close(self):
        self.server.close()


# A new make is one more class above, and one more entry here.
MAKES = {"abb": Abb, "other": Other}


@pytest.fixture(autouse=True)
def _other_make(monkeypatch):
    monkeypatch.setitem(connect.ARMS, "other", "other_make:arm")


@pytest.fixture(params=MAKES)
def any_arm(request):
    made = MAKES[request.param]()
    yield made
    made.close()


@pytest.fixture
def rig():
    made = Abb()
    yield made
    made.close()


# -- every make -----------------------------------------------------------------------------------


def test_connecting_moves_nothing(any_arm):
    with any_arm.open() as arm:
        assert isinstance(arm, ports.Arm)
        assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
    assert any_arm.moves == 0


def test_one_opened_for_reading_cannot_be_commanded(any_arm):
    with any_arm.open(read_only=True) as arm:
        assert tuple(arm.pose()) == pytest.approx((0.0, 0.0, 100.0, 0.0), abs=0.01)
        with pytest.raises(ReadOnlyError, match="dry run"):
            arm.move_linear(10.0, 0.0, 90.0, 0.1, 200.0)
        arm.pose()
    assert any_arm.moves == 0


def test_a_move_ends_where_it_was_sent(any_arm):
    rng = random.Random(1)
    with any_arm.open() as arm:
        a = 0.0
        for _ in range(10):
            x, y, z = rng.uniform(-100, 100), rng.uniform(-100, 100), rng.uniform(5, 80)
            low, high = arm.turn_range(x, y)
            a = rng.uniform(max(low, a - 2.9), min(high, a + 2.9))
            arm.move_linear(x, y, z, a, 500.0)
            assert any_arm.truth()[:3] == pytest.approx((x, y, z), abs=0.001)
            seen = arm.pose()
            assert seen[:3] == pytest.approx((x, y, z), abs=0.011)
            assert math.remainder(seen[3] - a, math.tau) == pytest.approx(0.0, abs=0.003)


def test_nothing_is_known_against_a_short_way_in_the_middle(any_arm):
    with any_arm.open(base=BASE) as arm:
        assert arm.obstacle((0.0, 0.0, 60.0, 0.0), (10.0, 5.0, 60.0, 3.0)) == ""
    assert any_arm.moves == 0


def test_a_move_is_over_when_the_call_returns(any_arm):
    with any_arm.open() as arm:
        arm.move_linear(50.0, 0.0, 50.0, 1.0, 100.0)
        here = any_arm.truth()
        time.sleep(0.05)
        assert any_arm.truth() == here


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e6])
def test_numbers_that_cannot_be_sent_are_refused_and_the_arm_stays_usable(any_arm, bad):
    with any_arm.open() as arm:
        for target in ((bad, 0.0, 50.0, 0.0), (0.0, 0.0, bad, 0.0)):
            with pytest.raises(ArmError, match="not moved") as raised:
                arm.move_linear(*target, 100.0)
            assert raised.value.exit_code == 22
        for speed in (0.0, -5.0, math.nan):
            with pytest.raises(ArmError):
                arm.move_linear(0.0, 0.0, 50.0, 0.0, speed)
        assert any_arm.moves == 0
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)
        assert any_arm.moves == 1


def test_what_is_out_of_reach_is_refused_and_the_arm_stays_usable(any_arm):
    with any_arm.open(base=BASE) as arm:
        with pytest.raises(ArmError, match=r"not moved.*reach"):
            arm.move_linear(any_arm.far_mm, 0.0, 50.0, 0.0, 5000.0)
        assert any_arm.moves == 0
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)


def test_after_a_silence_everything_is_refused(any_arm):
    with any_arm.open() as arm:
        any_arm.silence()
        with pytest.raises(ArmError) as raised:
            arm.pose()
        assert raised.value.exit_code == 22
        for call in (arm.pose, lambda: arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)):
            with pytest.raises(ArmError, match="state unknown since"):
                call()
    assert any_arm.moves == 0


# -- the open_abb driver --------------------------------------------------------------------------


def test_settings_of_the_last_client_do_not_matter(rig):
    with rig.open(tool=Pose(0.0, 0.0, 120.0, (1.0, 0.0, 0.0, 0.0))) as arm:
        assert arm.pose().z_mm == pytest.approx(-20.0)
        arm.move_linear(10.0, 0.0, 10.0, 0.0, 50.0)
    with rig.open() as arm:
        assert arm.pose().z_mm == pytest.approx(130.0)


def test_work_object_is_the_frame_of_poses(rig):
    with rig.open(work_object=Pose(20.0, 0.0, 10.0, (1.0, 0.0, 0.0, 0.0))) as arm:
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 200.0)
    assert rig.model.pose_at(1e9)[:3] == pytest.approx((0.0, 0.0, 50.0))
    with rig.open() as arm:
        assert arm.pose()[:3] == pytest.approx((20.0, 0.0, 60.0))


def test_silence_makes_the_state_unknown_and_further_motion_refused(rig):
    with rig.open() as arm:
        with pytest.raises(ArmError, match="silence"):
            arm.move_linear(900.0, 0.0, 50.0, 0.0, 5000.0)
        for call in (arm.pose, lambda: arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)):
            with pytest.raises(ArmError, match="state unknown since"):
                call()
    assert rig.model.moves == 0


def test_whole_turns_are_counted_from_the_joints(rig):
    with rig.open(base=BASE) as arm:
        began = rig.model.joints_at(1e9)[5]
        for number in range(1, 5):
            arm.move_linear(0.0, 0.0, 60.0, number * math.pi / 2.0, 500.0)
        assert rig.model.joints_at(1e9)[5] == pytest.approx(began - 360.0)
        assert arm.pose().angle_rad == pytest.approx(2.0 * math.pi, abs=0.003)
        low, high = arm.turn_range(0.0, 0.0)
        assert (math.degrees(low), math.degrees(high)) == pytest.approx((-210.0, 570.0), abs=0.1)
    with rig.open(base=BASE) as arm:  # another client counts the same
        assert arm.pose().angle_rad == pytest.approx(2.0 * math.pi, abs=0.003)
        assert arm.turn_range(0.0, 0.0) == pytest.approx((low, high), abs=0.003)


@pytest.mark.parametrize("way", [-1, 1])
def test_what_would_wind_the_wrist_up_is_never_sent(rig, way):
    with rig.open(base=BASE) as arm:
        turned = 0.0
        with pytest.raises(ArmError, match=r"not moved.*farther round than the wrist turns"):  # noqa: PT012
            while abs(turned) < 1200.0:
                arm.move_linear(0.0, 0.0, 50.0, math.radians(turned + 60.0 * way), 500.0)
                turned += 60.0 * way
        assert (turned, rig.model.halted) == (-180.0 if way < 0 else 540.0, "")
        arm.move_linear(0.0, 0.0, 50.0, math.radians(turned - 60.0 * way), 500.0)


@pytest.mark.parametrize("angle_deg", [-175.0, 180.0, 350.0])
def test_half_a_turn_in_one_motion_is_refused_for_it_may_go_either_way(rig, angle_deg):
    with rig.open(base=BASE) as arm, pytest.raises(ArmError, match="either way"):
        arm.move_linear(0.0, 0.0, 50.0, math.radians(angle_deg), 500.0)
    assert rig.moves == 0


def test_the_wrists_range_may_be_narrowed_and_one_beyond_it_only_turned_back(rig):
    with contextlib.closing(connect.arm(rig.url + "?base=-300,0,0&wrist=-90,90", time_scale=SCALE)) as arm:
        low, high = arm.turn_range(0.0, 0.0)  # axis 6 stands at 180 deg
        assert (math.degrees(low), math.degrees(high)) == pytest.approx((100.0, 260.0), abs=0.1)
        arm.move_linear(0.0, 0.0, 60.0, 0.0, 500.0)
        with pytest.raises(ArmError, match="not moved"):
            arm.move_linear(0.0, 0.0, 60.0, -0.1, 500.0)
        arm.move_linear(0.0, 0.0, 60.0, 1.0, 500.0)


def test_a_wrist_that_somebody_else_turned_round_is_found(rig):
    with rig.open(base=BASE) as arm:
        arm.move_linear(0.0, 0.0, 60.0, 0.5, 500.0)
        *others, wrist = rig.model.joints_at(rig.now())
        told = " ".join(f"{joint:.4f}" for joint in (*others, wrist - 360.0))
        rig.model.execute(f"2 {told} #", rig.now())
        time.sleep(2.0 / SCALE)
        with pytest.raises(ArmError, match="whole turns off") as raised:
            arm.turn_range(0.0, 0.0)
        assert raised.value.exit_code == 22


def test_a_controller_whose_wrist_is_at_its_end_halts_without_a_word():
    model = ArmModel(BASE)
    number, answer = 0, Answer("", 0.0)
    while not model.halted:
        number += 1
        w, x = math.cos(math.radians(50.0 * number)), math.sin(math.radians(50.0 * number))
        answer = model.execute(f"1 0 0 60 0 {w:.6f} {x:.6f} 0 #", 100.0 * number)
    assert (answer.text, model.halted) == (None, "50027 joint out of range")


def test_a_vanished_clients_move_does_not_confuse_the_next(rig):
    stranger = socket.create_connection(("127.0.0.1", rig.server.port))
    stranger.sendall(b"8 20 90 #")
    assert stranger.recv(16) == b"8 1 "
    stranger.sendall(b"1 60 0 100 0 1 0 0 #")
    time.sleep(0.02)
    stranger.close()
    time.sleep(0.15)
    with rig.open() as arm:
        assert arm.pose().x_mm == pytest.approx(60.0)
        arm.move_linear(0.0, 0.0, 50.0, 0.0, 100.0)


def test_reconnecting_at_once_works(rig):
    for _ in range(5):
        with rig.open() as arm:
            assert arm.pose().z_mm == pytest.approx(100.0)


def test_an_interrupted_move_is_waited_for_before_the_next_command(rig):
    class Interrupted(BaseException):
        pass

    with rig.open() as arm:
        arm.move_linear(0.0, 0.0, 99.0, 0.0, 20.0)
        receive = arm._stream.receive

        def interrupt(seconds):
            arm._stream.receive = receive
            raise Interrupted

        arm._stream.receive = interrupt
        with pytest.raises(Interrupted):
            arm.move_linear(100.0, 0.0, 100.0, 0.0, 20.0)
        assert arm.pose().x_mm == pytest.approx(100.0)


def stopped(arm, times):
    """Let the process be stopped past the deadline, so many times that it waits for an answer."""
    receive = arm._stream.receive

    def waited(seconds):
        nonlocal times
        if seconds < 0.1 or not times:
            return receive(seconds)
        times -= 1
        time.sleep(seconds + 0.02)
        return b""

    arm._stream.receive = waited


def test_a_move_that_ended_while_the_process_was_stopped_has_ended(rig):
    with rig.open() as arm:
        arm.pose()
        stopped(arm, 2)  # for the speed's answer, and for the move's
        arm.move_linear(10.0, 0.0, 100.0, 0.0, 50.0)
        assert arm.pose().x_mm == pytest.approx(10.0)


def test_a_pose_that_waited_while_the_process_was_stopped_is_asked_for_again(rig):
    with rig.open() as arm:
        stopped(arm, 1)
        assert arm.pose().z_mm == pytest.approx(100.0)
        stopped(arm, 2)
        with pytest.raises(ArmError, match="answered, but this process was stopped or starved"):
            arm.pose()
        assert arm.pose().z_mm == pytest.approx(100.0)


@pytest.mark.parametrize(
    "url",
    [
        *("tcp://127.0.0.1:1", "tcp://127.0.0.1", "rtu+tcp://127.0.0.1:5000", "x"),
        *("tcp://127.0.0.1:5000?base=1,2", "tcp://127.0.0.1:5000?area=1,2,3", "tcp://127.0.0.1:5000?tool=x"),
    ],
)
def test_nobody_there(url):
    with pytest.raises(PortError):
        connect.arm(url)


def test_frames_and_limits_may_stand_in_the_address(rig):
    query = "?tool=0,0,120&work_object=20,0,10,1,0,0,0&base=-300,0,0&area=-50,-50,-500,50,50,90"
    with contextlib.closing(connect.arm(rig.url + query, time_scale=SCALE)) as arm:
        assert arm.pose()[:3] == pytest.approx((-20.0, 0.0, -30.0))
        arm.move_linear(0.0, 0.0, 0.0, 0.0, 500.0)
        with pytest.raises(ArmError, match="outside the work area"):
            arm.move_linear(0.0, 51.0, 0.0, 0.0, 500.0)
        assert rig.moves == 1
        assert rig.model.pose_at(1e9)[2] == pytest.approx(0.0)


def test_the_way_is_looked_at_and_not_only_its_end(rig):
    """Both ends are in reach, the way between them leads through the arm's own foot."""
    with rig.open(base=BASE, work_object=BASE) as arm:
        arm.move_linear(250.0, 250.0, 100.0, 0.0, 1000.0)
        with pytest.raises(ArmError, match="out of the arm's reach"):
            arm.move_linear(-250.0, -250.0, 100.0, 0.0, 1000.0)
        arm.move_linear(250.0, -250.0, 100.0, 0.0, 1000.0)


class Impostor:
    """Accepts connections and answers every message with the same bytes; hangs up after `answers` of them."""

    def __init__(self, answer, answers=1000):
        self.answer, self.answers = answer, answers
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self.listener.getsockname()[1]}"
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        with contextlib.suppress(OSError):
            while True:
                client, _ = self.listener.accept()
                with client:
                    for _ in range(self.answers):
                        if not client.recv(100):
                            break
                        client.sendall(self.answer)

    def close(self):
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.thread.join()


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"HTTP/1.1 400 Bad Request", "does not fit"),
        (b"0 0 ", "bad message"),
        (b"0 1 ", "does not fit|silence"),  # also to SET_TOOL: the echoed code is checked
        (b"0 1 0 1 ", "does not fit"),
    ],
)
def test_whoever_is_no_open_abb_server_is_refused(answer, message):
    impostor = Impostor(answer)
    try:
        with pytest.raises(ArmError, match=message):
            connect.arm(impostor.url, time_scale=SCALE)
    finally:
        impostor.close()


def test_a_server_that_hangs_up_is_tried_again_and_then_given_up():
    impostor = Impostor(b"", answers=0)
    try:
        with pytest.raises(ArmError, match="connection broke"):
            connect.arm(impostor.url, time_scale=SCALE)
    finally:
        impostor.close()
