"""The ports of a simulated UR controller: the secondary interface, and the RTDE stream."""

import asyncio
import struct
from collections.abc import Callable

from drivers.sim.devices.ur_controller import Fields, UrModel
from drivers.sim.wire.serving import HOST, Site
from drivers.ur.arm import SCRIPT_PORT_BELOW
from drivers.ur.rtde import FORMATS, HEADER

CONTROLLER_VERSION = (5, 16, 0, 0)
LEAST_HZ, MOST_HZ = 1.0, 500.0


def served(model: UrModel, site: Site) -> tuple[int, "RtdePort"]:
    """Opens both ports of a controller.

    Returns:
        Number of the secondary interface's port, and the RTDE port, whose number is greater by two.
    """

    async def take(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
        while True:
            program = await reader.readuntil(b"\nend\n")
            model.take(program.decode("latin-1"), site.now())

    while True:
        script_port = site.listen(take)
        try:
            return script_port, RtdePort(model, site, script_port + SCRIPT_PORT_BELOW)
        except (OSError, OverflowError):  # the number for RTDE is taken, or beyond 65535
            site.call(site.shut, script_port)


class RtdePort:
    """Port that serves RTDE version 2: sends outputs, refuses inputs, and is silent while `mute` is set."""

    def __init__(self, model: UrModel, site: Site, port: int, host: str = HOST) -> None:
        self.mute = False
        self.port = port
        self._look = lambda: model.fields(site.now())
        site.listen(self._serve, port, host)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = _Session(self._look)
        while True:
            try:
                async with asyncio.timeout(session.period_s if session.started else None):
                    head = await reader.readexactly(HEADER.size)
            except TimeoutError:
                data = session.data()
            else:
                size, kind = HEADER.unpack(head)
                payload = await reader.readexactly(max(size - HEADER.size, 0))
                data = session.answer(chr(kind), payload)
            if not self.mute:
                writer.write(data)
                await writer.drain()


class _Session:
    """State of one client: its output recipe, the period, and whether data is being sent."""

    def __init__(self, look: Callable[[], Fields]) -> None:
        self.started = False
        self.period_s = 0.1  # wall
        self._look = look
        self._names: list[str] = []

    def answer(self, kind: str, payload: bytes) -> bytes:
        """The reply to one package; empty if the package is not understood."""
        if kind == "V":
            return _packed(kind, b"\1" if payload == b"\0\2" else b"\0")
        if kind == "v":
            return _packed(kind, struct.pack(">4I", *CONTROLLER_VERSION))
        if kind == "O" and len(payload) > 8:
            rate = min(max(struct.unpack(">d", payload[:8])[0], LEAST_HZ), MOST_HZ)
            # Some clients end the list with a comma.
            self._names = payload[8:].decode("latin-1").rstrip(",").split(",")
            self.period_s = 1.0 / rate
            offered = self._look()
            kinds = [offered[name][0] if name in offered else "NOT_FOUND" for name in self._names]
            self._names = self._names if "NOT_FOUND" not in kinds else []
            return _packed(kind, bytes((bool(self._names),)) + ",".join(kinds).encode())
        if kind == "I":
            return _packed(kind, b"\0" + ",".join("IN_USE" for _ in payload.split(b",")).encode())
        if kind in "SP":
            self.started = kind == "S" and bool(self._names)
            return _packed(kind, bytes((kind == "P" or self.started,)))
        return b""

    def data(self) -> bytes:
        """A data package with the current values of the output recipe."""
        fields = self._look()
        shown = (fields[name] for name in self._names)
        values = (struct.pack(">" + FORMATS[kind], *numbers) for kind, numbers in shown)
        return _packed("U", b"\1" + b"".join(values))


def _packed(kind: str, payload: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload
