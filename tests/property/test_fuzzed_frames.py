"""The frame parsers under generated input: whole, cut, repeated, damaged and arbitrary frames."""

import random

from fuzz_frames import CORPUS, case
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.modbus.framing import RtuFraming
from drivers.robotiq.modbus import RTU, TCP, read_request
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.wire.modbus import crc16
from drivers.sim.wire.rtu import MbapSlave

CASES = settings(max_examples=100, derandomize=True)
listeners, cuts = st.integers(0, 2), st.integers(0, 31)
frames = st.sampled_from([bytes(frame[2:]) for frame in CORPUS])
noise = st.binary(max_size=40)


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    frame = bytearray(draw(frames))
    at = draw(st.integers(0, len(frame) - 1))
    frame[at : at + draw(st.integers(0, 3))] = draw(st.binary(max_size=3))
    return bytes(frame)


@CASES
@given(listeners, cuts, st.lists(st.one_of(frames, damaged(), st.binary(max_size=12)), max_size=6))
def test_framing_damaged_frames_accepts_only_sound_ones(listener, cut, said) -> None:
    case(bytes((listener, cut)) + b"".join(said))


@CASES
@given(st.binary(max_size=300))
def test_framing_arbitrary_bytes_accepts_only_sound_frames(data) -> None:
    case(data)


@CASES
@given(st.lists(st.binary(max_size=60), max_size=5))
def test_mbap_slave_feed_arbitrary_bytes_raises_nothing(pieces) -> None:
    slave = MbapSlave(GripperRegisters(GripperModel(random.Random(1)), lambda: 0.01), unit=TCP.unit)
    for piece in pieces:
        slave.feed(piece)


def reply(block: bytes) -> bytes:
    body = bytes((9, 3, 6)) + block
    return body + crc16(body)


@CASES
@given(noise, st.binary(min_size=6, max_size=6), noise)
def test_rtu_framing_find_in_noise_returns_a_whole_answer(before, block, after) -> None:
    said = before + reply(block) + after
    result = RtuFraming().find(said, read_request(RTU, 3))
    assert result is not None
    assert reply(b"".join(value.to_bytes(2, "big") for value in result.registers)) in said
