"""Frames printed in the manuals of the 2F-85, byte for byte: the driver sends and the simulator answers them.

The frames are those of `[M16]` p61-67 and `[M18]` p54, 62, and include their CRCs.
"""

import random

import pytest
from lines import Line

from drivers.clock import Pace
from drivers.robotiq.modbus import ModbusLink
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.wire.rtu import RtuSlave

RESET = "09 10 03E8 0003 06 0000 0000 0000 7330"
ACTIVATE = "09 10 03E8 0003 06 0100 0000 0000 72E1"
CLOSE = "09 10 03E8 0003 06 0900 00FF FFFF 4229"
OPEN = "09 10 03E8 0003 06 0900 0000 FFFF 7219"
WRITTEN = "09 10 03E8 0003 0130"
READ_1 = "09 03 07D0 0001 85CF"
READ_3 = "09 03 07D0 0003 040E"
READ_3_INPUT = "09 04 07D0 0003 B1CE"
READ_WRITE = "09 17 07D0 0002 03E9 0002 04 00E6 3CC8 2D0C"


class Canned:
    """A Modbus device whose registers have the fixed content of a manual's example."""

    functions = frozenset({3, 23})

    def __init__(self, registers=""):
        self.block = bytes.fromhex(registers)

    def serves(self, address, count):
        return address == 0x07D0 and 2 * count <= len(self.block)

    def read(self, address, count):
        return self.block[: 2 * count]

    def write(self, address, data):
        return True


def exchange(slave, request):
    (piece,) = slave.feed(bytes.fromhex(request))
    return piece.data


@pytest.mark.parametrize(
    ("registers", "request_frame", "reply"),
    [
        ("1100", READ_1, "09 03 02 1100 55D5"),  # activating
        ("3100", READ_1, "09 03 02 3100 4C15"),  # active
        ("B900 00FF BD00", READ_3, "09 03 06 B900 00FF BD00 1D7C"),  # gripped
        ("F900 0000 0D00", READ_3, "09 03 06 F900 0000 0D00 564C"),  # opened
        ("0100 09E6", READ_WRITE, "09 17 04 0100 09E6 F6C1"),
    ],
)
def test_rtu_slave_request_of_manual_gets_its_answer(registers, request_frame, reply):
    assert exchange(RtuSlave(Canned(registers)), request_frame) == bytes.fromhex(reply)


@pytest.mark.parametrize("request_frame", [RESET, ACTIVATE, CLOSE, OPEN])
def test_gripper_registers_write_of_manual_is_stored(request_frame):
    model = GripperModel(random.Random(1))
    slave = RtuSlave(GripperRegisters(model, lambda: 0.01))
    assert exchange(slave, request_frame) == bytes.fromhex(WRITTEN)
    assert model.read_output()[:6] == bytes.fromhex(request_frame)[7:13]


def test_gripper_registers_functions_3_and_4_read_same_block():
    slave = RtuSlave(GripperRegisters(GripperModel(random.Random(1)), lambda: 0.01))
    by_3, by_4 = exchange(slave, READ_3), exchange(slave, READ_3_INPUT)
    assert by_3[2:-2] == by_4[2:-2]
    assert (by_3[1], by_4[1]) == (3, 4)


def test_gripper_registers_read_write_writes_first_and_shows_fault_9():
    """The answer in the manual shows gPR as just written, and fault 9 for the silence before."""
    now = [5.0]
    model = GripperModel(random.Random(1))
    slave = RtuSlave(GripperRegisters(model, lambda: now[0]))
    reply = exchange(slave, READ_WRITE)
    assert reply[:3] == bytes.fromhex("09 17 04")
    assert reply[5:7] == bytes.fromhex("09E6")
    assert model.read_output()[2:6] == bytes.fromhex("00E63CC8")


def link(reply):
    line = Line([(0.004, bytes.fromhex(reply))])
    return ModbusLink(line, Pace(line.clock)), line


@pytest.mark.parametrize("frame", [RESET, ACTIVATE, CLOSE, OPEN])
def test_modbus_link_write_sends_frame_of_manual(frame):
    channel, line = link(WRITTEN)
    channel.write(bytes.fromhex(frame)[7:13])
    assert [data for _, data in line.sent] == [bytes.fromhex(frame)]


def test_modbus_link_read_sends_frame_of_manual():
    channel, line = link("09 03 06 B900 00FF BD00 1D7C")
    assert channel.read() == bytes.fromhex("B900 00FF BD00")
    assert [data for _, data in line.sent] == [bytes.fromhex(READ_3)]
