"""The simulated gripper behind Robotiq's URCap: `GET` and `SET` lines on a TCP port, many clients at once."""

import contextlib
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass

from drivers.robotiq.registers import INPUT_FIELDS, OUTPUT_FIELDS, pack, unpack
from drivers.robotiq.urcap import READ
from drivers.sim.wire.modbus import Device
from drivers.sim.wire.serving import Lock, TcpServer

FLAGS = {"ACT": "rACT", "GTO": "rGTO", "ATR": "rATR", "ADR": "rARD"}
OUTPUTS = {**FLAGS, "POS": "rPR", "SPE": "rSP", "FOR": "rFR"}
UNKNOWN = b"?"
MAX_LINE = 256


@dataclass
class Urcap:
    """Answers of the URCap to lines."""

    device: Device
    now: Callable[[], float]  # simulated seconds
    # Suffix of the answer to a question; an acknowledgement has none.
    line_end: bytes = b"\n"

    def answer(self, line: bytes) -> bytes | None:
        """The answer; None: silence."""
        match line.decode("latin-1").split():
            case ["GET", name] if name in READ:
                fields = unpack(INPUT_FIELDS, self.device.read_input(self.now()))
                return b"%s %d" % (name.encode(), fields[READ[name]]) + self.line_end
            case ["GET", name] if name in OUTPUTS:
                fields = unpack(OUTPUT_FIELDS, self.device.read_output())
                return b"%s %d" % (name.encode(), fields[OUTPUTS[name]]) + self.line_end
            case ["SET", *words] if words and len(words) % 2 == 0:
                return b"ack" if self._set(words) else UNKNOWN
        return UNKNOWN

    def _set(self, words: list[str]) -> bool:
        image = unpack(OUTPUT_FIELDS, self.device.read_output())
        for name, text in zip(words[::2], words[1::2], strict=True):
            most = 1 if name in FLAGS else 255
            if name not in OUTPUTS or not text.isdecimal() or int(text) > most:
                return False
            image[OUTPUTS[name]] = int(text)
        self.device.write_output(0, pack(OUTPUT_FIELDS, image), self.now())
        return True


class UrcapPort(TcpServer):
    """The URCap on a TCP port.

    Args:
        urcap: answers lines.
        lock: held while a line is served.
    """

    def __init__(self, urcap: Urcap, lock: Lock) -> None:
        super().__init__("urcap", threading.Event())
        self.urcap = urcap
        self._lock = lock
        self.url = f"urcap://127.0.0.1:{self.port}"

    def _run(self) -> None:
        served: list[threading.Thread] = []
        while not self._stopped.is_set():
            if self._readable([self._listener]):
                client, _ = self._listener.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                served.append(threading.Thread(target=self._talk, args=(client,), daemon=True))
                served[-1].start()
        self._listener.close()
        for thread in served:
            thread.join()

    def _talk(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            self._serve(client)

    def _serve(self, client: socket.socket) -> None:
        text = b""
        for data in self._received(client, MAX_LINE):
            if len(text) > MAX_LINE:
                return
            *lines, text = (text + data).split(b"\n")
            for line in lines:
                with self._lock:
                    said = self.urcap.answer(line)
                if said is not None:
                    client.sendall(said)
