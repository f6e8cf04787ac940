"""What every gripper must do (drivers/ports.py), against each make and bus of `gripper_rigs`.

A new make is one more entry there; the real one, with nothing between its jaws, passes too.
"""

import contextlib
import threading

import pytest
from gripper_rigs import RIGS, Robotiq

from drivers import connect, ports
from drivers.errors import GripperFault, LinkError, LinkTimeout, PortError, ReadOnlyError


@pytest.fixture(autouse=True)
def _other_make(monkeypatch):
    """The one line by which another make becomes known."""
    monkeypatch.setitem(connect.GRIPPERS, "other", "other_make:gripper")


@pytest.fixture(params=RIGS)
def rig(request):
    made = RIGS[request.param]()
    yield made
    made.close()


def test_connecting_reads_and_does_not_write(rig):
    with rig.open() as gripper:
        assert isinstance(gripper, ports.Gripper)
        assert not gripper.state().activated
    assert not rig.commanded()


def test_one_opened_for_reading_cannot_be_commanded(rig):
    with rig.open() as gripper:
        gripper.activate()
    before = rig.commands()
    with rig.open(read_only=True) as gripper:
        assert gripper.state().activated
        with pytest.raises(ReadOnlyError, match="dry run"):
            gripper.move(255, 255, 10)
        with pytest.raises(ReadOnlyError, match="dry run"):
            gripper.stop()
        assert gripper.state().activated
    assert rig.commands() == before


def test_activate_move_wait(rig):
    with rig.open() as gripper:
        gripper.activate()
        assert gripper.state().activated
        gripper.move(255, 255, 10)
        settled = gripper.wait()
        assert (settled.position_counts, settled.object_flag, settled.echo_counts) == (
            rig.closed_counts,
            3,
            255,
        )
        gripper.move(100, 255, 10)
        settled = gripper.wait()
        assert (settled.position_counts, settled.echo_counts) == (100, 100)
        assert settled.seconds > 0.0


def test_a_part_stops_the_jaws(rig):
    with rig.open() as gripper:
        gripper.activate()
        rig.put_part()
        gripper.move(255, 100, 10)
        settled = gripper.wait()
        assert (settled.position_counts, settled.object_flag) == (rig.contact_counts, 2)


def test_a_holding_gripper_survives_a_reconnection(rig):
    with rig.open() as gripper:
        gripper.activate()
        rig.put_part()
        gripper.move(255, 100, 10)
        gripper.wait()
    with rig.open() as gripper:
        seen = gripper.state()
        assert (seen.activated, seen.position_counts, seen.echo_counts) == (True, rig.contact_counts, 255)
        gripper.activate()
        assert gripper.state().position_counts == rig.contact_counts


def test_moves_need_activation(rig):
    with rig.open() as gripper, pytest.raises(GripperFault, match="not active"):
        gripper.move(255, 255, 0)
    assert not rig.commanded()


def test_stopping_halfway_leaves_the_jaws_there(rig):
    with rig.open() as gripper:
        gripper.activate()
        gripper.move(255, 0, 0)
        gripper.stop()
        here = gripper.state().position_counts
        threading.Event().wait(0.1)
        assert gripper.state().position_counts == here < rig.closed_counts


def test_waiting_for_nothing_is_refused(rig):
    with rig.open() as gripper:
        gripper.activate()
        with pytest.raises(GripperFault, match="no move"):
            gripper.wait()


def test_a_closed_link_stays_closed(rig):
    with rig.open() as gripper:
        gripper.close()
        with pytest.raises(LinkError, match="closed"):
            gripper.state()


def test_a_dead_device_is_a_timeout(rig):
    with rig.open() as gripper:
        rig.silence()
        with pytest.raises(LinkError) as raised:
            gripper.state()
        assert raised.value.exit_code == 20
        if isinstance(raised.value, LinkTimeout):
            assert isinstance(raised.value, TimeoutError)


@pytest.mark.parametrize("bus", ["pty", "rtu+tcp", "tcp", "can"])
def test_an_activation_that_is_cut_short_and_stopped_stands_still_and_may_begin_anew(bus):
    class Interrupted(BaseException):
        pass

    with contextlib.closing(RIGS[bus]()) as rig, rig.open() as gripper:
        idle = gripper._pace.idle

        def interrupt(until):
            idle(until)
            if gripper.state().position_counts > 60:
                raise Interrupted

        gripper._pace.idle = interrupt
        with pytest.raises(Interrupted):
            gripper.activate()
        gripper.stop()
        here = gripper.state()
        threading.Event().wait(0.1)
        assert gripper.state().position_counts == here.position_counts > 60
        assert (here.enabled, here.activated) == (False, False)
        gripper._pace.idle = idle
        gripper.activate()
        assert gripper.state().activated


def test_closing_a_modbus_tcp_link_stops_the_jaws_and_no_other_does():
    for bus in ("pty", "rtu+tcp", "tcp", "can"):
        rig = Robotiq(bus)
        with rig.open() as gripper:
            gripper.activate()
            gripper.move(255, 0, 0)
        threading.Event().wait(0.15)
        assert bool(rig.model.read_output()[0] & 0x08) == (bus != "tcp")
        rig.close()


def test_a_port_that_does_not_exist():
    with pytest.raises(PortError, match="does not exist; list ports with") as raised:
        connect.gripper("/dev/ttyNowhere")
    assert raised.value.exit_code == 23


@pytest.mark.parametrize(
    "port",
    [
        *("tcp://127.0.0.1:1", "rtu+tcp://127.0.0.1:1", "tcp://127.0.0.1", "udp://x:1", "tcp://:x"),
        *("tcp://127.0.0.1:99999", "tcp://[::1", "tcp://127.0.0.1:502/path", "tcp://127.0.0.1:502?unit=2"),
    ],
)
def test_ports_nobody_serves(port):
    with pytest.raises(PortError) as raised:
        connect.gripper(port)
    assert "\n" not in str(raised.value)


def test_a_file_is_no_port(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(PortError, match="not a serial port"):
        connect.gripper(str(tmp_path / "file"))


def test_a_character_device_may_be_no_serial_port_either():
    with pytest.raises(PortError, match="cannot be opened as a serial port"):
        connect.gripper("/dev/null")


def test_a_port_has_one_owner():
    made = Robotiq("pty")
    try:
        with made.open(), pytest.raises(PortError, match="in use"):
            connect.gripper(made.name)
    finally:
        made.close()


def test_a_silent_line_times_out_and_the_next_answer_is_not_stale():
    """The slave is deaf for a moment; afterwards driver and device are in step again."""
    made = Robotiq("pty")
    try:
        told = []
        with made.open(report=lambda kind, fields: told.append(fields["incident"])) as gripper:
            gripper.activate()
            feed, made.slave.feed = made.slave.feed, lambda data: []
            with pytest.raises(LinkTimeout):
                gripper.state()
            made.slave.feed = feed
            gripper.move(77, 255, 0)
            assert gripper.wait().position_counts == 77
            assert told == ["no answer", "read repeated", "no answer", "read repeated", "no answer"]
    finally:
        made.close()


def test_an_unplugged_adapter_is_not_reopened():
    made = Robotiq("pty")
    with made.open() as gripper:
        made.close()
        with pytest.raises(LinkError, match="broke"):
            gripper.state()
        with pytest.raises(LinkError, match="closed"):
            gripper.state()
    with pytest.raises(PortError):
        connect.gripper(made.name)
