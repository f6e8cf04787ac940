"""Functions of RAPID that SERVER.mod uses: strings, single-precision numbers, the message parser."""

import math
import re
import struct

from drivers.abb.codec import Pose

MAX_PARAMETERS = 10  # VAR num params{10}
_VALUE = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


class RapidError(Exception):
    """A RAPID runtime error, which the server's error handler catches."""


def to_value(text: str) -> float | None:
    """Parses a number in single precision, as RAPID's StrToVal does; None if the text is no number."""
    if not _VALUE.fullmatch(text):
        return None
    try:
        return float(struct.unpack("<f", struct.pack("<f", float(text)))[0])
    except OverflowError:
        return None


def to_string(value: float, decimals: int) -> str:
    """Formats a number with `decimals` decimals, rounded half away from zero, as RAPID's NumToStr does."""
    scaled = math.floor(abs(value) * 10.0**decimals + 0.5)
    text = f"{scaled / 10.0**decimals:.{decimals}f}"
    return f"-{text}" if value < 0 and scaled else text


def pose_string(pose: Pose, decimals: int) -> str:
    """Formats a pose as seven numbers: mm with `decimals` decimals, the quaternion with three."""
    shift = (to_string(mm, decimals) for mm in pose[:3])
    return " ".join((*shift, *(to_string(part, 3) for part in pose.rotation)))


def match(text: str, position: int, pattern: str) -> int:
    """Searches for `pattern` from `position` on, as RAPID's StrMatch does; returns its 1-based index.

    Without a match, the index is one past the end.
    """
    result = text.find(pattern, position - 1)
    return result + 1 if result >= 0 else len(text) + 1


class Message:
    """The last message as parsed; values persist between messages, like SERVER.mod's global variables."""

    def __init__(self) -> None:
        self.code = 0.0  # instructionCode, kept when a head is malformed
        # params{1..10}: an unreadable number leaves the old value in place.
        self.parameters = [0.0] * MAX_PARAMETERS
        self.count = 0  # nParams; -1 for a malformed message

    def parse(self, text: str) -> None:
        """Parses one received string (PROC ParseMsg); raises RapidError if it has too many parameters."""
        end = match(text, 1, "#")
        after = match(text, 1, " ") + 1
        code = to_value(text[: after - 2])
        if end > len(text) or code is None:
            self.count = -1
            return
        self.code = code
        count = 0
        while True:
            start, after = after, match(text, after, " ") + 1
            if after > end:
                break
            if count == MAX_PARAMETERS:
                raise RapidError("array index out of bounds: params{11}")
            value = to_value(text[start - 1 : after - 2])
            if value is not None:
                self.parameters[count] = value
            count += 1
        self.count = count
