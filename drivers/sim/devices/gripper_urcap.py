"""The simulated gripper behind Robotiq's URCap: `GET` and `SET` lines on a TCP port, many clients at once."""

import contextlib
import socketserver
import threading
from collections.abc import Callable
from dataclasses import dataclass

from drivers.robotiq.registers import INPUT_FIELDS, OUTPUT_FIELDS, pack, unpack
from drivers.robotiq.urcap import READ
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.wire.serving import LibraryServer, Lock, ThreadForEach

FLAGS = {"ACT": "rACT", "GTO": "rGTO", "ATR": "rATR", "ADR": "rARD"}
OUTPUTS = {**FLAGS, "POS": "rPR", "SPE": "rSP", "FOR": "rFR"}
UNKNOWN = b"?"
MAX_LINE = 256


@dataclass
class Urcap:
    """Answers of the URCap to lines."""

    device: GripperModel
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


class UrcapPort(LibraryServer):
    """The URCap on a TCP port, a thread for each client.

    Args:
        urcap: answers lines.
        lock: held while a line is served.
    """

    def __init__(self, urcap: Urcap, lock: Lock) -> None:
        class Client(socketserver.StreamRequestHandler):
            """Answers one client's lines."""

            disable_nagle_algorithm = True

            def handle(self) -> None:
                with contextlib.suppress(OSError):
                    while (line := self.rfile.readline(MAX_LINE)).endswith(b"\n"):
                        with lock:
                            said = urcap.answer(line)
                        self.wfile.write(said or b"")

        server = ThreadForEach(("127.0.0.1", 0), Client)
        super().__init__("urcap", threading.Event(), server)
        self.urcap = urcap
        self.url = f"urcap://127.0.0.1:{server.server_address[1]}"
