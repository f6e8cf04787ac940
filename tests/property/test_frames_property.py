"""Whatever comes over the wire, the search for an answer neither raises nor believes what was not sent."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.modbus.framing import RtuFraming, TcpFraming
from drivers.robotiq.frames import RTU, TCP, read_request, write_request
from drivers.sim.devices.gripper_tcp import MbapSlave
from drivers.sim.wire.modbus import answer, crc16
from drivers.sim.wire.rtu import RtuSlave

FRAMING = RtuFraming()
READ, WRITE = read_request(RTU, 3), write_request(RTU, bytes.fromhex("0900 00FF FFFF"))
BLOCKS = st.binary(min_size=6, max_size=6)
NOISE = st.binary(max_size=40)


def reply(block):
    body = bytes((9, 3, 6)) + block
    return body + crc16(body)


@given(NOISE, BLOCKS, NOISE)
def test_an_answer_is_found_in_any_noise(before, block, after):
    result = FRAMING.find(before + reply(block) + after, READ)
    assert result is not None
    read = b"".join(register.to_bytes(2, "big") for register in result.registers)
    assert read == block or reply(read) in before + reply(
        block
    )  # noise that is a whole answer comes first


@given(BLOCKS, st.integers(0, 87))
def test_a_flipped_bit_is_no_answer(block, bit):
    damaged = bytearray(reply(block))
    damaged[bit // 8] ^= 1 << bit % 8
    assert FRAMING.find(bytes(damaged), READ) is None


@given(BLOCKS, st.integers(0, 10))
def test_a_truncated_frame_is_no_answer(block, length):
    assert FRAMING.find(reply(block)[:length], READ) is None


@given(st.binary(max_size=300))
def test_no_bytes_raise(data):
    FRAMING.find(data, READ)
    FRAMING.find(data, WRITE)
    request = read_request(TCP, 3)
    request.transaction_id = 1
    TcpFraming().find(data, request)


class Nothing:
    """Registers that remember whether they were written."""

    def __init__(self):
        self.written = []

    def serves(self, function, address, count):
        return True

    def read(self, address, count):
        return bytes(2 * count)

    def write(self, function, address, data):
        self.written.append((function, address, data))
        return True


@given(st.lists(st.binary(max_size=60), max_size=5))
def test_no_bytes_make_a_slave_raise_or_obey_without_a_crc(pieces):
    registers = Nothing()
    slave, tcp = RtuSlave(registers), MbapSlave(registers)
    for piece in pieces:
        written = len(registers.written)
        slave.feed(piece)
        assert len(registers.written) == written or b"\x09" in b"".join(pieces)
        tcp.feed(piece)
        slave.silence()


@given(st.binary(max_size=40))
def test_an_answer_always_repeats_the_function(pdu):
    said = answer(pdu, Nothing())
    assert said is None or said[0] == pdu[0]
