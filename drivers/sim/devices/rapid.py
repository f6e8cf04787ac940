"""RAPID for SERVER.mod: string functions, single-precision numbers, the message parser."""

import math
import re
import struct

from drivers.abb.codec import Pose

MAX_PARAMETERS = 10  # VAR num params{10}
_VALUE = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


class RapidError(Exception):
    """A RAPID runtime error that the server's error handler catches."""


def to_value(text: str) -> float | None:
    """StrToVal for a num: single precision, or None where RAPID answers FALSE."""
    if not _VALUE.fullmatch(text):
        return None
    try:
        return float(struct.unpack("<f", struct.pack("<f", float(text)))[0])
    except OverflowError:
        return None


def to_string(value: float, decimals: int) -> str:
    """NumToStr: rounded half away from zero, to `decimals` decimals."""
    scaled = math.floor(abs(value) * 10.0**decimals + 0.5)
    text = f"{scaled / 10.0**decimals:.{decimals}f}"
    return f"-{text}" if value < 0 and scaled else text


def pose_string(pose: Pose, decimals: int) -> str:
    """The seven numbers of a robtarget: mm with `decimals` decimals, the quaternion with three."""
    shift = (to_string(mm, decimals) for mm in pose[:3])
    return " ".join((*shift, *(to_string(part, 3) for part in pose.rotation)))


def match(text: str, position: int, pattern: str) -> int:
    """StrMatch: 1-based index of `pattern` from `position` on; one past the end if there is none."""
    result = text.find(pattern, position - 1)
    return result + 1 if result >= 0 else len(text) + 1


class Message:
    """The parser's state, which persists between messages: SERVER.mod's globals."""

    def __init__(self) -> None:
        self.code = 0.0  # instructionCode, kept when a head is malformed
        # params{1..10}: an unreadable number leaves the old value in place.
        self.parameters = [0.0] * MAX_PARAMETERS
        self.count = 0  # nParams; -1 for a malformed message

    def parse(self, text: str) -> None:
        """Parses one received string (PROC ParseMsg); raises RapidError for too many parameters."""
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
