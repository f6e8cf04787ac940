"""The ports of a simulated UR controller: the secondary interface, and the RTDE stream."""

import socket
import struct
import threading
from collections.abc import Callable

from drivers.sim.devices.ur_controller import Fields, UrModel
from drivers.sim.wire.serving import Lock, SimulatedTime, TcpServer
from drivers.ur.arm import SCRIPT_PORT_BELOW
from drivers.ur.rtde import FORMATS, HEADER

CONTROLLER_VERSION = (5, 16, 0, 0)
LEAST_HZ, MOST_HZ = 1.0, 500.0


def served(
    model: UrModel, lock: Lock, time: SimulatedTime, host: str = "127.0.0.1"
) -> tuple["SecondaryPort", "RtdePort"]:
    """Opens both ports of a controller, the secondary interface two below RTDE."""
    while True:
        script_port = SecondaryPort(model, lock, time, (host, 0))
        try:
            return script_port, RtdePort(
                model, lock, time, (host, script_port.port + SCRIPT_PORT_BELOW)
            )
        except (OSError, OverflowError):  # taken, or beyond the last one
            script_port.close()


class UrPort(TcpServer):
    """A port of the controller; `mute`: it sends nothing."""

    def __init__(
        self, model: UrModel, lock: Lock, time: SimulatedTime, address: tuple[str, int]
    ) -> None:
        super().__init__("ur", threading.Event(), address)
        self.mute = False
        self._model, self._lock, self._time = model, lock, time


class SecondaryPort(UrPort):
    """The secondary interface: receives programs, and sends nothing."""

    def _serve(self, client: socket.socket) -> None:
        text = ""
        for data in self._received(client):
            text += data.decode("latin-1")
            while (end := text.find("\nend\n")) >= 0:
                program, text = text[: end + 5], text[end + 5 :]
                with self._lock:
                    self._model.take(program, self._time.now())


class RtdePort(UrPort):
    """RTDE version 2 for one client: outputs only; inputs are refused."""

    def _serve(self, client: socket.socket) -> None:
        session = _Session(self._fields)
        buffer = b""
        while not self._stopped.is_set():
            if self._readable([client], session.wait_s):
                data = client.recv(4096)
                if not data:
                    return
                buffer += data
                while (
                    len(buffer) >= HEADER.size
                    and len(buffer) >= (size := HEADER.unpack_from(buffer)[0]) > 2
                ):
                    package, buffer = buffer[:size], buffer[size:]
                    self._send(client, session.answer(package))
            elif session.started:
                self._send(client, session.data())

    def _send(self, client: socket.socket, data: bytes) -> None:
        if not self.mute:
            client.sendall(data)

    def _fields(self) -> Fields:
        with self._lock:
            return self._model.fields(self._time.now())


class _Session:
    """One client's recipes."""

    def __init__(self, look: Callable[[], Fields]) -> None:
        self.started = False
        self.wait_s = 0.1
        self._look = look
        self._names: list[str] = []
        self._period_s = 0.1

    def answer(self, package: bytes) -> bytes:
        """The reply to one package."""
        kind, payload = chr(package[2]), package[HEADER.size :]
        if kind == "V":
            return _packed(kind, b"\1" if payload == b"\0\2" else b"\0")
        if kind == "v":
            return _packed(kind, struct.pack(">4I", *CONTROLLER_VERSION))
        if kind == "O" and len(payload) > 8:
            rate = min(max(struct.unpack(">d", payload[:8])[0], LEAST_HZ), MOST_HZ)
            # Some clients end the list with a comma.
            self._names = payload[8:].decode("latin-1").rstrip(",").split(",")
            self._period_s = 1.0 / rate
            offered = self._look()
            kinds = [offered[name][0] if name in offered else "NOT_FOUND" for name in self._names]
            self._names = self._names if "NOT_FOUND" not in kinds else []
            return _packed(kind, bytes((bool(self._names),)) + ",".join(kinds).encode())
        if kind == "I":
            return _packed(kind, b"\0" + ",".join("IN_USE" for _ in payload.split(b",")).encode())
        if kind in "SP":
            self.started = kind == "S" and bool(self._names)
            self.wait_s = self._period_s if self.started else 0.1
            return _packed(kind, bytes((kind == "P" or self.started,)))
        return b""

    def data(self) -> bytes:
        """One data package."""
        fields = self._look()
        values = b"".join(
            struct.pack(">" + FORMATS[fields[name][0]], *fields[name][1]) for name in self._names
        )
        return _packed("U", b"\1" + values)


def _packed(kind: str, payload: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload
