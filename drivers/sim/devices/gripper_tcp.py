"""The simulated gripper on a TCP port: RTU frames as through a serial device server, or Modbus TCP.

Over Modbus TCP the blocks start at 0, the unit is 2, and closing the connection stops the jaws ([M200] p66).
"""

import asyncio
import contextlib
from collections.abc import Callable

from drivers.sim.devices.gripper import GripperModel
from drivers.sim.wire.line import UnpluggedError
from drivers.sim.wire.modbus import answer
from drivers.sim.wire.rtu import Slave, exchange
from drivers.sim.wire.serving import Site

HEADER = 7  # MBAP: transaction, protocol 0, length, unit


class MbapSlave(Slave):
    """A slave with Modbus TCP framing; frames of another unit or protocol get no answer."""

    @property
    def pending(self) -> bool:
        """Always False: TCP delivers every byte."""
        return False

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


def stop_jaws(device: GripperModel, now: Callable[[], float]) -> None:
    """Sets rGTO to 0, as the gripper does when a Modbus TCP connection closes."""
    action = device.read_output()[0] & ~0x08
    device.write_output(0, bytes((action,)), now())


def open_port(slave: Slave, site: Site, left: Callable[[], None] = lambda: None) -> int:
    """Opens a TCP port that serves one client after the other; returns its number.

    Args:
        slave: the device.
        site: where it is served.
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
