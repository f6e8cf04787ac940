"""What every gripper must do, run against each transport of the driver and the simulator behind it.

A new make of gripper is one more entry in `RIGS`; the real one, with nothing between its jaws, passes too.
"""

import contextlib
import random
import threading
import time

import pytest

from drivers import connect
from drivers.errors import GripperFault, LinkError, LinkTimeout, PortError
from drivers.sim.gripper import GripperModel
from drivers.sim.gripper_tcp import TcpPort, modbus_tcp, rtu_over_tcp, stop_jaws
from drivers.sim.jaws import Jaws
from drivers.sim.modbus import GripperRegisters
from drivers.sim.rtu import PtyPort, RtuSlave

SCALE = 20.0


class Rig:
    """A simulated gripper on some port, and something between its fingers."""

    def __init__(self, kind):
        start = time.monotonic()
        self.now = lambda: (time.monotonic() - start) * SCALE
        self.contact = None
        lock = threading.RLock()
        self.model = GripperModel(random.Random(1), Jaws(), self)
        if kind == "pty":
            slave = RtuSlave(GripperRegisters(self.model, self.now))
            self.port = PtyPort(slave, lock, lambda s: time.sleep(s / SCALE))
            self.name = self.port.path
        elif kind == "rtu+tcp":
            self.port = TcpPort(rtu_over_tcp(self.model, self.now), lock, lambda: None)
            self.name = f"rtu+tcp://{self.port.address}"
        else:
            hung_up = lambda: stop_jaws(self.model, self.now)  # noqa: E731
            self.port = TcpPort(modbus_tcp(self.model, self.now), lock, hung_up)
            self.name = f"tcp://{self.port.address}"
        self.port.start()

    def closing(self):
        return self.contact

    def gripped(self):
        pass

    def open(self):
        return contextlib.closing(connect.gripper(self.name, time_scale=SCALE))


@pytest.fixture(params=["pty", "rtu+tcp", "tcp"])
def rig(request):
    made = Rig(request.param)
    yield made
    made.port.close()


def test_connecting_reads_and_does_not_write(rig):
    with rig.open() as gripper:
        assert not gripper.state().activated
    assert rig.model.read_output() == bytes(16)


def test_activate_move_wait(rig):
    with rig.open() as gripper:
        gripper.activate()
        assert gripper.state().activated
        gripper.move(255, 255, 10)
        settled = gripper.wait()
        assert (settled.position_counts, settled.object_flag, settled.echo_counts) == (230, 3, 255)
        gripper.move(100, 255, 10)
        assert gripper.wait().position_counts == 100


def test_a_part_stops_the_jaws(rig):
    with rig.open() as gripper:
        gripper.activate()
        rig.contact = 174
        gripper.move(255, 100, 10)
        settled = gripper.wait()
        assert (settled.position_counts, settled.object_flag) == (174, 2)
        assert settled.current_ma > 0


def test_a_holding_gripper_survives_a_reconnection(rig):
    with rig.open() as gripper:
        gripper.activate()
        rig.contact = 174
        gripper.move(255, 100, 10)
        gripper.wait()
    with rig.open() as gripper:
        seen = gripper.state()
        assert (seen.activated, seen.position_counts, seen.echo_counts) == (True, 174, 255)
        gripper.activate()
        assert gripper.state().position_counts == 174


def test_moves_need_activation(rig):
    with rig.open() as gripper, pytest.raises(GripperFault, match="not active"):
        gripper.move(255, 255, 0)


def test_a_closed_link_stays_closed(rig):
    with rig.open() as gripper:
        gripper.close()
        with pytest.raises(LinkError, match="closed"):
            gripper.state()


def test_closing_a_modbus_tcp_link_stops_the_jaws_and_closing_rtu_does_not(rig):
    with rig.open() as gripper:
        gripper.activate()
        gripper.move(255, 0, 0)
    time.sleep(0.15)
    going = rig.model.read_output()[0] & 0x08
    assert bool(going) == (not rig.name.startswith("tcp"))


def test_a_dead_device_is_a_timeout(rig):
    with rig.open() as gripper:
        rig.port.close()
        with pytest.raises(LinkError) as raised:
            gripper.state()
        assert raised.value.exit_code == 20
        if isinstance(raised.value, LinkTimeout):
            assert isinstance(raised.value, TimeoutError)
    rig.port.close = lambda: None


def test_a_port_that_does_not_exist():
    with pytest.raises(PortError, match="does not exist; list ports with") as raised:
        connect.gripper("/dev/ttyNowhere")
    assert raised.value.exit_code == 23


@pytest.mark.parametrize(
    "port",
    ["tcp://127.0.0.1:1", "rtu+tcp://127.0.0.1:1", "tcp://127.0.0.1", "udp://x:1", "tcp://:x", "can:can0"],
)
def test_ports_nobody_serves(port):
    with pytest.raises(PortError) as raised:
        connect.gripper(port)
    assert "\n" not in str(raised.value)


def test_a_file_is_no_port(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(PortError, match="not a serial port"):
        connect.gripper(str(tmp_path / "file"))


def test_a_port_has_one_owner():
    made = Rig("pty")
    try:
        with made.open(), pytest.raises(PortError, match="in use"):
            connect.gripper(made.name)
    finally:
        made.port.close()


def test_a_silent_line_times_out_and_the_next_answer_is_not_stale():
    """The slave is deaf for a moment; afterwards driver and device are in step again."""
    made = Rig("pty")
    slave = made.port._slave
    try:
        with made.open() as gripper:
            gripper.activate()
            feed, slave.feed = slave.feed, lambda data: []
            with pytest.raises(LinkTimeout):
                gripper.state()
            slave.feed = feed
            gripper.move(77, 255, 0)
            assert gripper.wait().position_counts == 77
    finally:
        made.port.close()


def test_the_pty_path_disappears_with_the_cell():
    made = Rig("pty")
    made.port.close()
    with pytest.raises(PortError):
        connect.gripper(made.name)
