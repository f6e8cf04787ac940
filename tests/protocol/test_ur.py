"""The UR driver and its simulated controller: faults during a move, and the client of ur_rtde."""

import contextlib
import json
import math
import os
import random
import socket
import sys
import time

import pytest
from arm_rigs import BASE, Ur
from impostor import Impostor
from lines import Line
from programs import ended, until

from drivers import connect
from drivers.abb.codec import IDENTITY, hand_rotation
from drivers.clock import Pace
from drivers.errors import ArmError
from drivers.sim.devices.arm import ArmModel
from drivers.sim.devices.ur_controller import PLAYING, PROTECTIVE_STOP, STOPPED, UrModel
from drivers.sim.devices.ur_ports import RtdePort
from drivers.sim.wire.serving import Site
from drivers.ur import arm as ur_arm
from drivers.ur import rtde, script

TARGET = (40.0, -30.0, 60.0, 0.5)
PAUSED = 4  # runtime state


@pytest.fixture
def rig():
    with contextlib.closing(Ur()) as result:
        yield result


def is_still(rig):
    here = rig.truth()
    time.sleep(0.05)
    return rig.truth() == here


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda model: setattr(model, "safety_bits", PROTECTIVE_STOP), "protective stop"),
        (lambda model: setattr(model, "safety_bits", 0), "safety state unknown"),
        (lambda model: setattr(model, "mode", 5), "not ready .robot mode 5"),
        (lambda model: setattr(model, "speed_fraction", 0.01), "speed slider stands at 1 %"),
        (lambda model: setattr(model, "_ends_s", math.inf), "a program runs on the controller"),
    ],
)
def test_move_linear_controller_not_ready_is_refused_and_pose_works(rig, change, message):
    with rig.open() as arm:
        here = arm.pose()
        change(rig.model)
        with pytest.raises(ArmError, match=f"not moved: .*{message}"):
            arm.move_linear(TARGET, 200.0)
        assert arm.pose() == here
    assert rig.moves == 0


def test_move_linear_without_remote_control_is_refused(rig, monkeypatch):
    monkeypatch.setattr(ur_arm, "ANSWER_S", 0.1)
    rig.model.remote = False
    with (
        rig.open() as arm,
        pytest.raises(ArmError, match="did not take a program; set the pendant to Remote"),
    ):
        arm.move_linear(TARGET, 200.0)
    assert rig.moves == 0


def test_move_linear_protective_stop_on_way_makes_state_unknown(rig):
    with rig.open() as arm:
        wait = arm._await_end

        def stopped(budget_s):
            rig.site.call(lambda: rig.model._halt(rig.now()))
            rig.model.safety_bits = PROTECTIVE_STOP
            wait(budget_s)

        arm._await_end = stopped
        with pytest.raises(ArmError, match=r"ended on the way \(protective stop"):
            arm.move_linear(TARGET, 5.0)
        with pytest.raises(ArmError, match="state unknown since"):
            arm.pose()
    assert is_still(rig)


def test_move_linear_another_program_on_way_is_reported(rig):
    with rig.open() as arm:
        wait = arm._await_end

        def intruded(budget_s):
            program = script.move(7, BASE, BASE, "v=1").decode()
            rig.site.call(lambda: rig.model.take(program, rig.now()))
            wait(budget_s)

        arm._await_end = intruded
        with pytest.raises(ArmError, match="another program moves it"):
            arm.move_linear(TARGET, 5.0)
        time.sleep(0.05)
        assert rig.model.registers[25] == 7  # the driver did not stop the other program


def test_move_linear_interrupted_stops_arm(rig):
    with rig.open() as arm:

        def interrupt(budget_s):
            raise KeyboardInterrupt

        arm._await_end = interrupt
        with pytest.raises(KeyboardInterrupt):
            arm.move_linear(TARGET, 2.0)
        until(lambda: is_still(rig))
        assert math.dist(rig.truth()[:3], TARGET[:3]) > 1.0
        with pytest.raises(ArmError, match="interrupted"):
            arm.pose()


def test_move_linear_not_arriving_stops_arm_at_deadline(rig, monkeypatch):
    with rig.open() as arm:
        monkeypatch.setattr("drivers.ur.arm._pacing", lambda motion: ("v=0.0001", 0.1))
        with pytest.raises(ArmError, match="not there after"):
            arm.move_linear(TARGET, 500.0)
    time.sleep(0.1)
    assert is_still(rig)


def test_move_linear_slow_slider_extends_deadline(rig):
    rig.model.speed_fraction = 0.1
    with rig.open() as arm:
        arm.move_linear(TARGET, 100.0)
        assert arm.pose()[:3] == pytest.approx(TARGET[:3], abs=0.01)


def test_pose_answers_read_too_late_state_remedy(rig):
    with rig.open() as arm:
        wait = arm._rtde._await

        def starved(kind):
            payload = wait(kind)
            arm._rtde._late_s = 1.5
            return payload

        arm._rtde._await = starved
        with pytest.raises(ArmError, match=r"read it 1\.5 s too late; take load off this"):
            arm.pose()


@pytest.mark.parametrize(
    "greeting", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0\4V\0", b"\0\1V"]
)
def test_connect_arm_server_other_than_ur_is_refused(greeting, monkeypatch):
    monkeypatch.setattr(rtde, "ANSWER_S", 0.2)
    says = pytest.raises(ArmError, match="RTDE")
    with contextlib.closing(Impostor(greeting=greeting)) as impostor, says:
        connect.arm(f"ur://{impostor.address}")


@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.4, 3.0, -3.1, math.pi])
def test_rotation_inverts_rotation_vector(turn):
    for rotation in (hand_rotation(turn), (math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2))):
        back = script.rotation(script.rotation_vector(rotation))
        same = sum(a * b for a, b in zip(back, rotation, strict=True))
        assert abs(same) == pytest.approx(1.0, abs=1e-12)


RECEIVER = """
import json, sys, time
from rtde_receive import RTDEReceiveInterface
fields = ["timestamp", "actual_TCP_pose", "actual_q", "robot_mode", "safety_status_bits", "runtime_state"]
client = RTDEReceiveInterface(sys.argv[1], 50.0, fields)
first = client.getTimestamp()
while client.getTimestamp() == first:
    time.sleep(0.01)
print(json.dumps([client.getActualTCPPose(), client.getActualQ(), client.getRobotMode(),
    client.getSafetyStatusBits(), client.getRuntimeState(), client.isConnected()]))
client.disconnect()
"""


def test_rtde_port_is_read_by_ur_rtde_receiver():
    """The receiver connects to port 30004 alone, so the controller gets a separate loopback address.

    It runs in a separate process, since connecting holds the global interpreter lock.
    """
    host = f"127.{os.getpid() >> 8 & 255}.{os.getpid() & 255}.7"
    arm = ArmModel(BASE)
    model = UrModel(arm, BASE)
    with Site() as site:
        RtdePort(model, site, rtde.PORT, host)
        done = ended([sys.executable, "-c", RECEIVER, host])
    pose, joints, *states = json.loads(done.out.splitlines()[-1])
    assert script.frame(pose)[:3] == pytest.approx((300.0, 0.0, 100.0), abs=1e-6)
    assert joints == pytest.approx([math.radians(angle) for angle in arm.joints_at(0.0)], abs=1e-9)
    assert states == [7, 1, 1, True]


def test_rtde_read_noise_raises_rtde_error():
    rng = random.Random(6)
    for _ in range(100):
        packages = b"".join(
            rtde.HEADER.pack(3 + size, rng.choice(b"VOSPUMI")) + rng.randbytes(size)
            for size in (rng.randrange(40) for _ in range(rng.randrange(8)))
        )
        line = Line(*[[(0.001, packages + rng.randbytes(rng.randrange(9)))] for _ in range(6)])
        with pytest.raises(rtde.RtdeError):
            rtde.Rtde(line, Pace(line.clock)).read()


@pytest.mark.parametrize("stops_s", [(0.2,), (0.2, 0.3)])
def test_ur_model_stopl_brakes_on_path_while_its_program_runs(stops_s):
    arm = ArmModel(BASE)
    model = UrModel(arm, BASE)
    start = arm.flange_at(0.0)
    target = start._replace(x_mm=start.x_mm + 200.0)
    model.take(script.move(7, IDENTITY, target, "v=0.25").decode(), 0.0)
    for now_s in stops_s:
        model.take(script.stop().decode(), now_s)
    stands_s = 0.2 + 0.25 / script.STOP_M_S2
    assert model.fields(stands_s - 0.01)["runtime_state"] == ("UINT32", (PLAYING,))
    stopped = model.fields(stands_s + 0.01)
    assert stopped["runtime_state"] == ("UINT32", (STOPPED,))
    assert stopped["actual_TCP_speed"] == ("VECTOR6D", (0.0,) * 6)
    way_mm = 50.0 + 1000.0 * 0.25**2 / (2.0 * script.STOP_M_S2)
    for seconds in (stands_s, 10.0):
        assert arm.flange_at(seconds).x_mm - start.x_mm == pytest.approx(way_mm, abs=0.2)
    model.advance(10.0)
    assert (model.registers[rtde.STARTED], model.registers[rtde.DONE]) == (7, 0)


def test_ur_model_after_noise_still_serves(rig):
    rng = random.Random(8)
    for port in (rig.rtde.port, rig.script_port):
        for _ in range(20):
            with socket.create_connection(("127.0.0.1", port)) as client:
                client.sendall(rng.randbytes(rng.randrange(1, 60)) + b"\nend\n")
    with rig.open() as arm:
        arm.move_linear(TARGET, 200.0)
    assert rig.moves == 1


def hold(rig, **changed):
    """Freezes what the controller reports: no progress, and the values in `changed`."""
    frozen = rig.model.fields(rig.now())
    frozen |= {name: (frozen[name][0], (value,)) for name, value in changed.items()}
    rig.model.fields = lambda now_s: frozen


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"runtime_state": PAUSED}, "the program is paused on the pendant"),
        ({"target_speed_fraction": 0.0}, "the speed slider stands at 0 %; raise it"),
        ({"target_speed_fraction": 0.06}, "the speed slider was lowered to 6 %"),
    ],
    ids=["paused", "slider at 0", "slider lowered"],
)
def test_move_linear_held_up_on_pendant_names_reason(rig, changed, reason):
    with rig.open() as arm:
        arm.pose()
        began = arm._await_start

        def held():
            began()
            rig.site.call(lambda: hold(rig, **changed))

        arm._await_start = held
        with pytest.raises(ArmError, match=f"not there after .*{reason}.*look at the pendant"):
            arm.move_linear(TARGET, 5.0)  # slow: it must not end before it is held up


def test_move_linear_paused_and_resumed_arrives(rig):
    with rig.open() as arm:
        arm.pose()
        began = arm._await_start

        def interrupted():
            began()
            rig.site.call(lambda: hold(rig, runtime_state=PAUSED))
            assert arm._read().runtime_state == PAUSED
            rig.site.call(lambda: delattr(rig.model, "fields"))

        arm._await_start = interrupted
        arm.move_linear(TARGET, 20.0)
        assert rig.truth() == pytest.approx(TARGET, abs=1e-3)
