"""The CANopen link on a virtual bus: order of the bytes, what is refused, silence, names of ports.

The object map is inferred (see drivers/robotiq/canopen.py); these tests hold the driver to that map and to
CiA 301, not to a device.
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
    """A gripper that remembers which bytes were written, in order."""

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


def test_the_block_is_read_byte_by_byte(device, link):
    assert link().read() == device.read_input(1.0)[:6]


def test_settings_are_written_first_then_what_changed_and_a_stop_before_all(device, link):
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


def test_an_absent_node_is_a_timeout(link):
    channel = link()
    lines = []
    channel._report = lambda kind, fields: lines.append(fields["incident"])
    with pytest.raises(LinkTimeout, match="node 11"):
        channel.read()
    assert lines == ["no answer", "read repeated", "no answer", "read repeated", "no answer"]


def test_a_write_that_was_not_acknowledged_is_written_again_when_asked_again(device, link):
    channel = link()
    channel.write(bytes((0x01, 0, 0, 0, 0, 0)))
    device.written.clear()
    ask, channel._ask = channel._ask, lambda *_: (_ for _ in ()).throw(LinkTimeout("lost"))
    with pytest.raises(LinkTimeout):
        channel.write(bytes((0x09, 0, 0, 0, 0, 0)))
    channel._ask = ask
    channel.write(bytes((0x09, 0, 0, 0, 0, 0)))
    assert device.written == [(0, 0x09)]


def test_an_object_that_is_not_there_is_a_refusal(device, link):
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
def test_an_answer_to_something_else_is_none(device, link, reply):
    channel = link()
    channel._sdo.request_response = lambda request: reply
    with pytest.raises(LinkTimeout):
        channel.read()


@pytest.mark.parametrize("error", [can.CanOperationError("down"), OSError(100, "network is down")])
def test_a_bus_that_breaks_stays_broken(device, link, error):
    channel = link()

    def broken(request):
        raise error

    channel._sdo.request_response = broken
    for says in ("broke", "closed"):
        with pytest.raises(LinkError, match=says):
            channel.read()


# -- names of ports -------------------------------------------------------------------------------


def test_a_ports_name_states_the_map():
    assert parse("can:can0") == CanMap("can0")
    stated = "can:vcan1?node=0x21&output=0x2300&input=8192&bitrate=250000&interface=virtual"
    assert parse(stated) == CanMap("vcan1", "virtual", 250000, 0x21, 0x2300, 0x2000)


NO_PORTS = [f"can:can0?{setting}" for setting in ("node=0", "node=128", "node=x", "colour=red")]
NO_PORTS += ["can:", "can:nobus7", "can:c?channel=d", "can:x?interface=nonsense"]
NO_PORTS += ["can:x?bitrate=5&interface=slcan"]


@pytest.mark.parametrize("port", NO_PORTS)
def test_names_that_are_not_understood_and_buses_that_are_not_there(port):
    with refused_in_a_line(PortError):
        connect.gripper(port)


def test_without_the_extra_the_port_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def refuse(name, *arguments, **options):
        if name in ("can", "canopen"):
            raise ImportError(f"No module named {name!r}")
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(PortError, match=r"squeezetree\[can\]"):
        driver.gripper("can:can0", Pace(Clock()), lambda kind, fields: None, read_only=False)


def test_opening_a_port_where_nobody_answers_leaves_no_bus_behind():
    before = threading.active_count()
    with pytest.raises(LinkTimeout):
        connect.gripper("can:empty?interface=virtual")
    assert threading.active_count() == before
