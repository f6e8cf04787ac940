"""The contract of every gripper (drivers/ports.py), tested on each make and bus.

A new make is one more entry of `RIGS`. A real gripper with nothing between its jaws passes, too.
"""

import contextlib
import threading

import pytest
from counting import width_um
from gripper_rigs import RIGS, Robotiq
from refusals import refused_in_a_line
from schunk_rigs import SchunkRig

from drivers import connect, links
from drivers.contract.gripper import GripperContract
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.robotiq import modbus
from runtime.table import PROFILES

RIGS |= {"schunk-egu": SchunkRig}


class TestGrippers(GripperContract):
    """The contract, on every make and bus."""

    @pytest.fixture(params=RIGS)
    def rig(self, request, monkeypatch):
        result = RIGS[request.param]()
        silence = result.silence

        def soon_noticed():
            monkeypatch.setattr(links, "LINK_TIMEOUT_S", 0.05)
            silence()

        result.silence = soon_noticed
        yield result
        result.close()


@pytest.mark.parametrize("bus", ["pty", "urcap"])
def test_stop_after_interrupted_activation_allows_a_new_one(bus):
    class Interrupted(BaseException):
        pass

    with contextlib.closing(RIGS[bus]()) as rig, rig.open() as gripper:
        idle = gripper._pace.idle

        def interrupt(*pause):
            idle(*pause)
            if gripper.state().width_um < 60_000:
                raise Interrupted

        gripper._pace.idle = interrupt
        with pytest.raises(Interrupted):
            gripper.activate()
        gripper.stop()
        here = gripper.state()
        threading.Event().wait(0.1)
        assert gripper.state().width_um == here.width_um < 60_000
        assert not here.activated
        gripper._pace.idle = idle
        gripper.activate()
        assert gripper.state().activated


@pytest.mark.parametrize("bus", ["rtu+tcp", "tcp"])
def test_close_stops_jaws_on_modbus_tcp_only(bus):
    with contextlib.closing(Robotiq(bus)) as rig:
        with rig.open() as gripper:
            gripper.activate()
            gripper.move(-1, 20.0, 20.0)
        threading.Event().wait(0.15)
        assert bool(rig.model.read_output()[0] & 0x08) == (bus != "tcp")


@pytest.mark.parametrize(
    ("port", "sentence"),
    [
        ("/dev/ttyNowhere", "does not exist; list ports with"),
        (__file__, "not a serial port"),
        ("/dev/null", "cannot be opened as a serial port"),
        *((f"{scheme}://127.0.0.1:1", ".") for scheme in ("tcp", "rtu+tcp")),
        *((port, ".") for port in ("udp://x:1", "tcp://:x", "tcp://127.0.0.1:99999")),
        *((port, ".") for port in ("tcp://[::1", "tcp://127.0.0.1:502/path")),
        *((f"{scheme}://{'x' * 300}:502", ".") for scheme in ("tcp", "rtu+tcp")),
        ("tcp://a..b:502", "."),
    ],
)
def test_connect_gripper_unserved_port_is_refused_in_a_line(port, sentence):
    with refused_in_a_line(PortError, sentence):
        connect.gripper(port)


def test_connect_gripper_of_other_profile_is_refused_and_closed(monkeypatch):
    def stubborn(makes, *settings, profile, **options):
        return modbus.gripper(*settings, profile=None, **options)

    monkeypatch.setattr(connect, "_opened", stubborn)
    with contextlib.closing(Robotiq("pty")) as gripper:
        with pytest.raises(PortError, match="is a robotiq-2f-85, not a hand-e"):
            connect.gripper(gripper.name, PROFILES["hand-e"])
        with contextlib.closing(connect.gripper(gripper.name)) as again:
            assert again.profile.model == "robotiq-2f-85"


def test_connect_gripper_port_in_use_is_refused():
    with (
        contextlib.closing(Robotiq("pty")) as gripper,
        gripper.open(),
        pytest.raises(PortError, match="in use"),
    ):
        connect.gripper(gripper.name)


def test_gripper_after_silence_takes_no_stale_answer(monkeypatch):
    lines = []
    report = lambda kind, fields: lines.append(fields["incident"])  # noqa: E731
    with contextlib.closing(Robotiq("pty")) as device, device.open(report=report) as gripper:
        gripper.activate()
        feed, device.slave.feed = device.slave.feed, lambda data: []
        with monkeypatch.context() as soon:
            soon.setattr(links, "LINK_TIMEOUT_S", 0.05)
            with pytest.raises(LinkTimeout):
                gripper.state()
        device.slave.feed = feed
        gripper.move(width_um(77), 150.0, 20.0)
        assert gripper.wait().width_um == width_um(77)
    assert lines == [*["no answer", "read repeated"] * 2, "no answer"]


def test_gripper_unplugged_adapter_is_not_reopened():
    device = Robotiq("pty")
    with device.open() as gripper:
        device.close()
        with pytest.raises(LinkError, match="broke"):
            gripper.state()
        with pytest.raises(LinkError, match="closed"):
            gripper.state()
    with pytest.raises(PortError):
        connect.gripper(device.name)
