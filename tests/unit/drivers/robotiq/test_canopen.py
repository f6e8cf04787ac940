"""The CANopen link on a virtual bus: order of the bytes, refusals, silence, names of ports.

The object map is inferred (see drivers/robotiq/canopen.py): these tests compare the driver with that map and
with CiA 301, not with a device.
"""

import builtins
import random
import struct
import threading

import can
import canopen
import pytest
from can_node import CanNode
from refusals import refused_in_a_line

from drivers import connect
from drivers.clock import Clock, Pace
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.robotiq import canopen as driver
from drivers.robotiq.canopen import CanLink, CanMap, parse
from drivers.sim.devices.gripper import GripperModel

CHANNEL = "unit"
WHERE = CanMap(CHANNEL, "virtual")


class Recorder(GripperModel):
    """A gripper that records which bytes were written, in order."""

    def __init__(self):
        super().__init__(random.Random(1))
        self.written = []

    def write_output(self, offset, data, now_s):
        self.written.append((offset, data[0]))
        super().write_output(offset, data, now_s)


@pytest.fixture
def device():
    result = Recorder()
    node = CanNode(result, lambda: 1.0, WHERE)
    yield result
    node.close()


@pytest.fixture
def link():
    result = []

    def build(where=WHERE):
        network = canopen.Network()
        network.NOTIFIER_CYCLE = driver.HEAR_S
        network.connect(interface=where.interface, channel=where.channel)
        result.append(CanLink(network, where, "can:unit"))
        return result[-1]

    yield build
    for each in result:
        each.close()


def test_can_link_read_returns_block(device, link):
    assert link().read() == device.read_input(1.0)[:6]


def test_can_link_write_sends_changes_in_safe_order(device, link):
    channel = link()
    for block, written in (
        ((0x09, 0, 0, 200, 100, 50), [(5, 50), (4, 100), (2, 0), (1, 0), (3, 200), (0, 0x09)]),
        ((0x09, 0, 0, 100, 100, 50), [(3, 100)]),
    ):
        channel.write(bytes(block))
        assert device.written == written
        device.written.clear()
    channel.write(bytes(6))
    assert device.written[0] == (0, 0)


def test_can_link_read_absent_node_times_out(link):
    channel = link()
    lines = []
    channel._report = lambda kind, fields: lines.append(fields["incident"])
    with pytest.raises(LinkTimeout, match="node 11"):
        channel.read()
    assert lines == ["no answer", "read repeated", "no answer", "read repeated", "no answer"]


def test_can_link_write_unacknowledged_byte_is_written_again(device, link):
    channel = link()
    channel.write(bytes((0x01, 0, 0, 0, 0, 0)))
    device.written.clear()
    ask, channel._ask = channel._ask, lambda *_: (_ for _ in ()).throw(LinkTimeout("lost"))
    with pytest.raises(LinkTimeout):
        channel.write(bytes((0x09, 0, 0, 0, 0, 0)))
    channel._ask = ask
    channel.write(bytes((0x09, 0, 0, 0, 0, 0)))
    assert device.written == [(0, 0x09)]


def test_can_link_read_missing_object_is_refused(device, link):
    with pytest.raises(LinkError, match=r"refused object 0x3000:1.*not verified") as raised:
        link(WHERE._replace(input=0x3000)).read()
    assert not isinstance(raised.value, LinkTimeout)


@pytest.mark.parametrize(
    "reply",
    [
        struct.pack("<BHBI", 0x4F, 0x2000, 2, 7),  # of another byte
        struct.pack("<BHBI", 0x4F, 0x2200, 1, 7),  # of another object
        struct.pack("<BHBI", 0x60, 0x2000, 1, 7),  # to another request
    ],
)
def test_can_link_read_answer_to_other_request_times_out(device, link, reply):
    channel = link()
    channel._sdo.request_response = lambda request: reply
    with pytest.raises(LinkTimeout):
        channel.read()


@pytest.mark.parametrize("error", [can.CanOperationError("down"), OSError(100, "network is down")])
def test_can_link_broken_bus_stays_broken(device, link, error):
    channel = link()

    def broken(request):
        raise error

    channel._sdo.request_response = broken
    for says in ("broke", "closed"):
        with pytest.raises(LinkError, match=says):
            channel.read()


# -- names of ports -------------------------------------------------------------------------------


def test_parse_port_gives_map():
    assert parse("can:can0") == CanMap("can0")
    stated = "can:vcan1?node=0x21&output=0x2300&input=8192&bitrate=250000&interface=virtual"
    assert parse(stated) == CanMap("vcan1", "virtual", 250000, 0x21, 0x2300, 0x2000)


NO_PORTS = [f"can:can0?{setting}" for setting in ("node=0", "node=128", "node=x", "colour=red")]
NO_PORTS += ["can:", "can:nobus7", "can:c?channel=d", "can:x?interface=nonsense"]
NO_PORTS += ["can:x?bitrate=5&interface=slcan"]


@pytest.mark.parametrize("port", NO_PORTS)
def test_connect_gripper_bad_can_port_is_refused_in_a_line(port):
    with refused_in_a_line(PortError):
        connect.gripper(port)


def test_gripper_without_can_extra_names_what_to_install(monkeypatch):
    real = builtins.__import__

    def refuse(name, *arguments, **options):
        if name in ("can", "canopen"):
            raise ImportError(f"No module named {name!r}")
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(PortError, match=r"squeezetree\[can\]"):
        driver.gripper("can:can0", Pace(Clock()), lambda kind, fields: None, read_only=False)


def test_connect_gripper_silent_can_bus_leaves_no_thread():
    before = threading.active_count()
    with pytest.raises(LinkTimeout):
        connect.gripper("can:empty?interface=virtual")
    assert threading.active_count() == before
