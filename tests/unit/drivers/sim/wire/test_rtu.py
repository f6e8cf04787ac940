"""An RTU slave answers whole frames, stays silent otherwise, and still answers after noise."""

import random

import pytest
from rtu_frames import rtu_frame

from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.wire.modbus import crc16
from drivers.sim.wire.rtu import RtuSlave

READ = bytes.fromhex("09 03 07D0 0003 040E")
READ_REPLY_LENGTH = 11


def fed(slave, data):
    """What the slave answers to the bytes `data`: a list of pieces."""
    return [piece.data for piece in slave.feed(data)]


@pytest.fixture
def slave():
    model = GripperModel(random.Random(1))
    return RtuSlave(GripperRegisters(model, lambda: 0.01))


@pytest.mark.parametrize(
    "request_text",
    [
        "09 03 07D0 0001",
        "09 04 07D0 0008",
        "09 03 03E8 0003",
        "09 06 03E8 0100",
        "09 10 03E9 0001 02 00FF",
        "09 10 03E8 0008 10 0000 0000 0000 0000 0000 0000 0000 0000",
        "09 17 07D0 0002 03E9 0002 04 00E6 3CC8",
    ],
)
def test_rtu_slave_served_request_is_answered_with_id_and_crc(slave, request_text):
    (reply,) = fed(slave, rtu_frame(request_text))
    assert reply[:2] == bytes.fromhex(request_text)[:2]
    assert crc16(reply[:-2]) == reply[-2:]


@pytest.mark.parametrize(
    "request_text",
    [
        "08 03 07D0 0003",  # another slave
        "00 10 03E8 0001 02 0100",  # broadcast
        "09 03 0000 0003",  # no such register
        "09 03 07D0 0009",  # runs over the end of the block
        "09 03 07CF 0003",  # starts before it
        "09 03 07D0 0000",  # nothing asked for
        "09 06 07D0 0100",  # input registers cannot be written
        "09 10 03E8 0002 02 0100",  # byte count contradicts the register count
        "09 10 03EF 0002 04 0100 0000",  # runs over the end
        "09 01 07D0 0003",  # coils: unknown here
        "09 2B 0E 01 00",  # device identification: unknown here
        "09 17 0000 0002 03E9 0002 04 00E6 3CC8",  # bad read half
        "09 17 07D0 0002 0000 0002 04 00E6 3CC8",  # bad write half
    ],
)
def test_rtu_slave_request_not_served_is_silent(slave, request_text):
    assert fed(slave, rtu_frame(request_text)) == []
    slave.silence()
    assert len(fed(slave, READ)[0]) == READ_REPLY_LENGTH


def test_rtu_slave_request_with_flipped_bit_is_silent(slave):
    for bit in range(8 * len(READ)):
        bad = bytearray(READ)
        bad[bit // 8] ^= 1 << bit % 8
        assert fed(slave, bytes(bad)) == []
        slave.silence()


def test_rtu_slave_request_in_two_pieces_is_answered(slave):
    for cut in range(1, len(READ)):
        assert fed(slave, READ[:cut]) == []
        assert slave.patience_s
        assert len(fed(slave, READ[cut:])) == 1
        assert not slave.patience_s


def test_rtu_slave_requests_in_one_piece_are_each_answered(slave):
    other = rtu_frame("08 03 07D0 0003")
    bad = READ[:-1] + b"\0"
    assert len(fed(slave, READ + other + READ + bad + READ)) == 3


def test_rtu_slave_random_noise_is_not_obeyed():
    rng = random.Random(3)
    model = GripperModel(random.Random(1))
    slave = RtuSlave(GripperRegisters(model, lambda: 0.01))
    for _ in range(1000):
        fed(slave, b"\x09" + rng.randbytes(rng.randrange(1, 24)))
        slave.silence()
    assert model.read_output() == bytes(16)
