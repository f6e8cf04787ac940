"""Slaves with RTU or Modbus TCP frames, and their ports; unsupported and damaged requests get no answer."""

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable

from drivers.robotiq.modbus import RTU
from drivers.sim.wire.line import BYTE_S, NETWORK_BYTE_S, Line, Outbox, Piece, UnpluggedError
from drivers.sim.wire.modbus import Registers, answer, crc16, frame_length
from drivers.sim.wire.serving import Site

# Wall; silence that ends a frame. A real line's 0.3 ms are less than what a scheduler keeps.
GAP_S = 0.010
CHUNK = 1024
HEADER = 7  # MBAP: transaction, protocol 0, length, unit


class Slave:
    """A slave on a bus, fed with bytes as they arrive; frames for other units get no answer.

    Args:
        registers: registers of the slave.
        line: carries the slave's frames.
        unit: slave id; by default the usual id of a Robotiq gripper.
    """

    gap_s: float | None = GAP_S

    def __init__(
        self, registers: Registers, line: Line | None = None, unit: int = RTU.unit
    ) -> None:
        self.unit = unit
        self._registers = registers
        self._line = line or Line()
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Piece]:
        """Takes bytes off the wire; returns the answers to the frames that they complete.

        Raises:
            UnpluggedError: the line is gone.
        """
        self._buffer += data
        pieces: list[Piece] = []
        while length := self._frame_length():
            if len(self._buffer) < length:
                break
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if self._line.hears():
                pieces += self._line.carries(frame, self.reply(frame))
        return pieces

    def silence(self) -> None:
        """Drops an incomplete frame, since the line has been silent: the next byte starts a new frame."""
        self._buffer.clear()

    @property
    def patience_s(self) -> float | None:
        """Silence after which an incomplete frame is to be dropped, wall seconds; None: drop nothing."""
        return self.gap_s if self._buffer else None

    def reply(self, frame: bytes) -> bytes | None:
        """Returns the answer to one frame, or None for silence."""
        raise NotImplementedError

    def _frame_length(self) -> int:
        """Length of the frame at the start of the buffer; 0: unknown."""
        raise NotImplementedError


class RtuSlave(Slave):
    """A slave with RTU framing: unit, PDU and CRC."""

    def reply(self, frame: bytes) -> bytes | None:
        """Returns the answer, or None for silence: wrong id, bad CRC, unknown function or address."""
        if len(frame) < 4 or frame[0] != self.unit or crc16(frame[:-2]) != frame[-2:]:
            return None
        pdu = answer(frame[1:-2], self._registers)
        if pdu is None:
            return None
        body = bytes((self.unit,)) + pdu
        return body + crc16(body)

    def _frame_length(self) -> int:
        return frame_length(self._buffer)


class MbapSlave(Slave):
    """A slave with Modbus TCP framing; frames of another unit or protocol get no answer."""

    gap_s = None  # TCP delivers every byte

    def reply(self, frame: bytes) -> bytes | None:
        """The answer with the request's transaction number, or None for silence."""
        if frame[2:4] != b"\0\0" or frame[6:7] != bytes((self.unit,)):
            return None
        pdu = answer(frame[HEADER:], self._registers)
        if pdu is None:
            return None
        return frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu

    def _frame_length(self) -> int:
        if len(self._buffer) < HEADER:
            return 0
        return HEADER - 1 + int.from_bytes(self._buffer[4:6], "big")


async def exchange(
    slave: Slave,
    reader: asyncio.StreamReader,
    write: Callable[[bytes], object],
    site: Site,
    byte_s: float = NETWORK_BYTE_S,
) -> None:
    """Serves one client of a device until the client leaves.

    Args:
        slave: the device.
        reader: data from the client.
        write: sends data to the client.
        site: simulated time.
        byte_s: duration of a byte, simulated seconds.

    Raises:
        OSError: the connection broke, or the fault schedule has unplugged the line.
    """
    outbox = Outbox(byte_s, site.at, write)
    while True:
        try:
            async with asyncio.timeout(slave.patience_s):
                data = await reader.read(CHUNK)
        except TimeoutError:
            slave.silence()
            continue
        if not data:
            return
        pieces = slave.feed(data)
        outbox.put(pieces, site.now() + len(data) * byte_s)


def open_port(slave: Slave, site: Site, left: Callable[[], None] = lambda: None) -> int:
    """Opens a TCP port that serves one client after the other; returns the number of the port.

    Args:
        slave: the device.
        site: simulated time and event loop.
        left: called when a client has left.
    """
    turn = asyncio.Lock()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with turn:
            try:
                with contextlib.suppress(ConnectionError):
                    await exchange(slave, reader, writer.write, site)
                left()
            except UnpluggedError:
                site.shut(port)

    port = site.listen(serve)
    return port


def open_pty(slave: RtuSlave, site: Site) -> str:
    """Opens a pseudo-terminal that serves a slave until the line is unplugged; returns the path for clients.

    Args:
        slave: the device.
        site: simulated time and event loop.
    """
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    path = os.ttyname(theirs)

    async def serve() -> None:
        # The slave end stays open here, too: else the master end reports an error whenever a client
        # leaves.
        with (
            os.fdopen(ours, "r+b", buffering=0) as master,
            os.fdopen(theirs, "r+b", buffering=0),
        ):

            def write(data: bytes) -> None:
                if not master.closed:  # a late answer
                    master.write(data)

            loop, reader = asyncio.get_running_loop(), asyncio.StreamReader()
            loop.add_reader(master, lambda: reader.feed_data(master.read(CHUNK) or b""))
            try:
                await exchange(slave, reader, write, site, BYTE_S)
            finally:
                loop.remove_reader(master)

    site.call(site.begin, serve)
    return path
