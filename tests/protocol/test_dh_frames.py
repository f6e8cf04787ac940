"""Frames printed in the manuals of DH-Robotics, byte for byte: the driver sends, the simulator answers them.

`drivers.dh.registers` names the manuals; the frames include their CRCs.
"""

import random

import pytest
from dh_devices import VirtualDh
from rtu_frames import rtu_frame
from schunk_rigs import Part

from drivers.dh import registers as dh
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.wire.rtu import RtuSlave
from runtime.table import profile_of

INITIALISE = "01 06 01 00 00 01 49 F6"  # [PGC] 2.3.3.1
CALIBRATE = "01 06 01 00 00 A5 48 4D"
SET_POSITION_500 = "01 06 01 03 01 F4 78 21"  # [PGC] 2.3.3.3
SET_SPEED_50 = "01 06 01 04 00 32 48 22"  # [PGC] 2.3.3.4
OPEN_FIRST = "01 06 03 01 00 00 D8 4E"  # [PGE] 3.3.4.9
SAVE = "01 06 03 00 00 01 48 4E"  # [PGE] 3.3.4.8
BAUD_115200 = "01 06 03 03 00 00 79 8E"  # [PGE] 3.3.4.11
STOP_BIT = "01 06 03 04 00 00 C8 4F"  # [PGE] 3.3.4.12
NO_PARITY = "01 06 03 05 00 00 99 8F"  # [PGE] 3.3.4.13
READ_INITIALISED = ("01 03 02 00 00 01 85 B2", "01 03 02 00 00 B8 44")  # [PGE] 3.3.4.5: no
READ_GRIP = ("01 03 02 01 00 01 D4 72", "01 03 02 00 02 39 85")  # [PGE] 3.3.4.6: caught


@pytest.fixture
def device():
    return DhModel(random.Random(1), Part(20.0), profile_of("dh-pgc140-50"))


def exchange(device, request, now_s=0.0):
    slave = RtuSlave(DhRegisters(device, lambda: now_s), None, dh.UNIT)
    return b"".join(piece.data for piece in slave.feed(bytes.fromhex(request)))


WRITES = (INITIALISE, CALIBRATE, SET_POSITION_500, SET_SPEED_50, OPEN_FIRST, SAVE)


@pytest.mark.parametrize("request_frame", [*WRITES, BAUD_115200, STOP_BIT, NO_PARITY])
def test_dh_registers_write_of_manual_is_repeated_as_answer(device, request_frame):
    assert exchange(device, request_frame) == bytes.fromhex(request_frame)
    assert device.writes == 1


def test_dh_registers_read_of_manual_gets_its_answer(device):
    question, answer = READ_INITIALISED
    assert exchange(device, question) == bytes.fromhex(answer)
    exchange(device, INITIALISE)
    device.write(dh.POSITION, 0, 2.0)
    question, answer = READ_GRIP
    assert exchange(device, question, 4.0) == bytes.fromhex(answer)


@pytest.mark.parametrize(
    ("body", "damage"),
    [
        ("02 06 01 00 00 01", 0),  # another unit
        ("01 06 01 00 00 01", 1),  # a wrong CRC
        ("01 03 05 00 00 01", 0),  # no such register
        ("01 04 02 00 00 01", 0),  # function 04 is not among those of [PGE] 3.3.2
    ],
)
def test_dh_registers_frame_not_served_is_silent(device, body, damage):
    frame = bytearray(rtu_frame(body))
    frame[-1] ^= damage
    assert exchange(device, frame.hex()) == b""
    assert device.writes == 0


def test_gripper_sends_frames_of_manual():
    device = VirtualDh()
    sent = []
    heard = device.port._slave.feed
    device.port._slave.feed = lambda data: sent.append(data) or heard(data)
    gripper = device.connect()
    assert not any(frame[1] == 6 for frame in sent)
    gripper.activate()
    gripper.move(47_500, 68.0, 160.0)
    gripper.wait()
    writes = [frame for frame in sent if frame[1] == 6]
    frames = (INITIALISE, SET_SPEED_50, SET_POSITION_500)
    assert writes == [*map(bytes.fromhex, frames)]
