"""Feeds arbitrary bytes to the gripper's line: to the simulated slave, or to the driver's masters.

`case` takes bytes from a fuzzer: the first byte chooses the receiver, the second the size of the pieces into
which the rest is cut. The receiver may answer or accept only what a sound frame among these bytes says;
otherwise it must stay silent, or raise an error of the link. The module finds the sound frames by trying
every position.
"""

import contextlib
import logging
import random

from direct_gripper import VirtualClock

from drivers.clock import Pace
from drivers.errors import LinkError
from drivers.modbus.framing import Framing, RtuFraming, TcpFraming
from drivers.ports import no_report
from drivers.robotiq.modbus import RTU, TCP, ModbusLink, Wiring
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.wire.modbus import crc16, frame_length
from drivers.sim.wire.rtu import RtuSlave

READ = bytes.fromhex("09 03 07D0 0003 040E")
READ_REPLY = bytes.fromhex("09 03 06 B900 00FF BD00 1D7C")
CLOSE = bytes.fromhex("09 10 03E8 0003 06 0900 00FF FFFF 4229")
READ_WRITE = bytes.fromhex("09 17 07D0 0002 03E9 0002 04 00E6 3CC8 2D0C")
TCP_REPLY = bytes.fromhex("0001 0000 0009 02 04 06 B900 00FF BD00")
WRITE_REPLY = bytes.fromhex("09 10 03E8 0003 0130")
SAID = ((READ, CLOSE, READ_WRITE), (READ_REPLY, WRITE_REPLY), (TCP_REPLY,))
SPOKEN = [(listener, frame) for listener, frames in enumerate(SAID) for frame in frames]
CORPUS = tuple(bytes((listener, 0)) + frame for listener, frame in SPOKEN)
MAX_PIECES = 64
CLOCK = VirtualClock()
# The driver does the same when it opens a port.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)


class FedStream:
    """A stream that receives the given pieces, then nothing."""

    endpoint = "fed"

    def __init__(self, pieces: list[bytes]) -> None:
        self.pieces = pieces

    def send(self, data: bytes) -> None:
        pass

    def receive(self, seconds: float) -> bytes:
        CLOCK.sleep(seconds)
        return self.pieces.pop(0) if self.pieces else b""

    def close(self) -> None:
        pass


def case(data: bytes) -> None:
    """Feeds the bytes of one case to the receiver that the first byte chooses.

    Raises:
        AssertionError: the receiver answered or accepted something that no sound frame says.
    """
    if len(data) < 2:
        return
    pieces = _cut(data[2:], data[1])
    (towards_slave, towards_rtu_master, towards_tcp_master)[data[0] % 3](pieces)


def towards_slave(pieces: list[bytes]) -> None:
    """Feeds the pieces to the simulated gripper, and checks its answers.

    Afterwards the gripper must answer a sound request.
    """
    model = GripperModel(random.Random(1))
    slave = RtuSlave(GripperRegisters(model, lambda: 0.01))
    replies = [reply for piece in pieces for reply, *_ in slave.feed(piece)]
    requests = _frames(b"".join(pieces), frame_length)
    assert len(replies) <= len(requests), "more answers than sound requests"
    for reply in replies:
        assert reply[0] == RTU.unit, "another slave answered"
        assert crc16(reply[:-2]) == reply[-2:], "an answer's CRC is wrong"
        assert reply[1] in {request[1] for request in requests}, "an answer to what nobody asked"
    slave.silence()
    ((reply, *_),) = slave.feed(READ)
    assert len(reply) == len(READ_REPLY), "deaf after noise"


def towards_rtu_master(pieces: list[bytes]) -> None:
    """Feeds the pieces to the driver as answers over Modbus RTU; checks what the driver accepts."""
    said = b"".join(pieces)
    blocks = {frame[3:9] for frame in _frames(said, _reply_length) if frame[1:3] == b"\x03\x06"}
    _believes(_link(pieces, RtuFraming(), RTU), blocks)


def towards_tcp_master(pieces: list[bytes]) -> None:
    """Feeds the pieces to the driver as answers over Modbus TCP; checks what the driver accepts."""
    said = b"".join(pieces)
    ends = range(len(said) - len(TCP_REPLY) + 1)
    replies = [said[at : at + len(TCP_REPLY)] for at in ends]
    blocks = {reply[9:] for reply in replies if reply[2:9] == TCP_REPLY[2:9]}
    _believes(_link(pieces, TcpFraming(), TCP), blocks)


def _link(pieces: list[bytes], framing: Framing, wiring: Wiring) -> ModbusLink:
    return ModbusLink(FedStream(pieces), Pace(CLOCK), no_report, wiring, framing)


def _believes(link: ModbusLink, blocks: set[bytes]) -> None:
    for _ in range(3):
        with contextlib.suppress(LinkError):
            assert link.read() in blocks, "a reading that no sound frame carried"
        with contextlib.suppress(LinkError):
            link.write(bytes(6))


def _cut(data: bytes, size: int) -> list[bytes]:
    """Cuts bytes into pieces, as a port may deliver them.

    A piece has `size` modulo 32 bytes; for 0 there is one piece. If this would give more
    than `MAX_PIECES` pieces, the pieces are longer.
    """
    step = max(size % 32 or len(data), -(-len(data) // MAX_PIECES), 1)
    return [data[at : at + step] for at in range(0, len(data), step)]


def _reply_length(head: bytes) -> int | None:
    return 3 + head[2] + 2 if len(head) > 2 else 0


def _frames(data: bytes, length_of) -> list[bytes]:
    """Returns all frames of slave 9 with the right CRC that begin anywhere in the bytes.

    `length_of` takes bytes that begin with a frame and returns the frame's length; 0 or None: unknown.
    """
    results = []
    for at in range(len(data)):
        length = length_of(data[at:]) if data[at] == RTU.unit else 0
        frame = data[at : at + (length or 0)]
        if length and len(frame) == length and crc16(frame[:-2]) == frame[-2:]:
            results.append(frame)
    return results
