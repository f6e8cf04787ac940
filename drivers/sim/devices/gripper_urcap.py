"""The simulated gripper behind Robotiq's URCap: answers to `GET` and `SET` lines."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.robotiq.registers import INPUT_FIELDS, OUTPUT_FIELDS, pack, unpack
from drivers.robotiq.urcap import READ
from drivers.sim.devices.gripper import GripperModel

FLAGS = {"ACT": "rACT", "GTO": "rGTO", "ATR": "rATR", "ADR": "rARD"}
OUTPUTS = {**FLAGS, "POS": "rPR", "SPE": "rSP", "FOR": "rFR"}
UNKNOWN = b"?"
MAX_LINE = 256


@dataclass
class Urcap:
    """The URCap of a simulated gripper: answers lines of text."""

    device: GripperModel
    now: Callable[[], float]  # simulated seconds
    # Suffix of the answer to a question; an acknowledgement has none.
    line_end: bytes = b"\n"

    def answer(self, line: bytes) -> bytes:
        """Returns the answer to one line."""
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
