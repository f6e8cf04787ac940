"""The open_abb wire protocol as `SERVER.mod` implements it: lines to the server, unterminated replies.

A command is `<code> (<number> )*#`. It has one space between fields and one before `#`; otherwise the server
loses the last parameter. If a number is garbled, the server keeps the parameter's old value and would move to
that. So numbers are formatted strictly.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from drivers.errors import shown

MAX_LINE = 80  # RAPID string limit of one SocketReceive \\Str
MAX_REPLY = 200  # seven numbers, of some ten characters each
MAX_NUMBERS = 10  # params{10} in SERVER.mod
MAX_MAGNITUDE = 1e5  # larger than any number sent to an arm; keeps lines short

PING, MOVE_LINEAR, READ_POSE, READ_JOINTS = 0, 1, 3, 4
SET_TOOL, SET_WORK_OBJECT, SET_SPEED, SET_ZONE = 6, 7, 8, 9
CLOSE = 99  # has no reply
# commands that neither move anything nor change a setting
HARMLESS = frozenset({PING, READ_POSE, READ_JOINTS, CLOSE})

# Number of fields in the reply to each code. 98 has free text and is left out.
REPLY_FIELDS = dict.fromkeys((0, 1, 2, 6, 7, 8, 9, 30, 31, 33, 34, 35, 36), 0)
REPLY_FIELDS |= {3: 7, 4: 6, 5: 6, 32: 1}
# Decimals of the last number of a reply, as SERVER.mod passes them to NumToStr.
REPLY_DECIMALS = {READ_POSE: 3, READ_JOINTS: 2}

Quaternion = tuple[float, float, float, float]


class Pose(NamedTuple):
    """A RAPID pose: mm, and a unit quaternion (w, x, y, z)."""

    x_mm: float
    y_mm: float
    z_mm: float
    rotation: Quaternion


IDENTITY = Pose(0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


class Reply(NamedTuple):
    """One answer of the server: `code` of the command, `done` (its ok flag) and `fields` (its payload)."""

    code: int
    done: bool
    fields: tuple[str, ...]

    @property
    def ended(self) -> bool:
        """Whether the reply is complete: it has no fields, or its last number has all its decimals."""
        if not self.fields:
            return True
        return len(self.fields[-1].partition(".")[2]) == REPLY_DECIMALS.get(self.code)


class ProtocolError(ValueError):
    """A message that must not be sent, or an answer that does not fit the question."""


def number(value: float, decimals: int) -> str:
    """Formats a number for the wire: fixed point, no exponent, no negative zero.

    Raises:
        ProtocolError: the number is not finite, or too large.
    """
    if not math.isfinite(value) or abs(value) >= MAX_MAGNITUDE:
        raise ProtocolError(f"{value} cannot be sent to the arm; stay below {MAX_MAGNITUDE:.0f}")
    text = f"{value:.{decimals}f}"
    return text[1:] if float(text) == 0.0 and text.startswith("-") else text


def command(code: int, *numbers: str) -> bytes:
    """Creates a command line, to be sent in one piece.

    Raises:
        ProtocolError: the line has more numbers or characters than the server can take.
    """
    line = " ".join((str(code), *numbers, "#"))
    if len(line) > MAX_LINE or len(numbers) > MAX_NUMBERS:
        raise ProtocolError(
            f"command too long, {len(line)} characters and {len(numbers)} numbers: {line}"
        )
    return line.encode("ascii")


def pose_numbers(pose: Pose) -> tuple[str, ...]:
    """Formats a pose as seven numbers: mm to 0.001, quaternion to 1e-7.

    Raises:
        ProtocolError: a number is not finite, or the quaternion not of unit length (RAPID would stop).
    """
    length = math.hypot(*pose.rotation)
    if not abs(length - 1.0) < 1e-6:
        raise ProtocolError(f"quaternion {pose.rotation} has length {length}; normalise it")
    position = (number(value, 3) for value in (pose.x_mm, pose.y_mm, pose.z_mm))
    return (*position, *(number(part, 7) for part in pose.rotation))


def speed_numbers(speed_mm_s: float, turn_rad_s: float) -> tuple[str, str]:
    """Formats a speed as two numbers: mm/s and deg/s to 0.001; raises the errors of `number`."""
    return number(speed_mm_s, 3), number(math.degrees(turn_rad_s), 3)


def hand_rotation(angle_rad: float) -> Quaternion:
    """Rotation of a hand that points down, turned by `angle_rad`: (0, cos a/2, sin a/2, 0)."""
    return (0.0, math.cos(angle_rad / 2.0), math.sin(angle_rad / 2.0), 0.0)


def hand_angle(rotation: Sequence[float]) -> float:
    """Angle of a hand that points down, from its quaternion (w, x, y, z); rad, from -pi to pi.

    Raises:
        ProtocolError: the hand is tilted by more than about 2 degrees.
    """
    w, x, y, z = rotation
    if math.hypot(w, z) > 0.02 or math.hypot(x, y) < 0.9:
        raise ProtocolError(f"the hand does not point down (quaternion {rotation}); jog it upright")
    return math.remainder(2.0 * math.atan2(y, x), math.tau)


def parse_reply(text: str, code: int) -> Reply | None:
    """Parses `text`, the received part of the reply to `code`; returns None while fields are missing.

    Replies have no terminator: the last number of the result may still lack digits (`Reply.ended`).

    Raises:
        ProtocolError: the text is not a reply to that code.
    """
    head, *payload = text.split(" ")
    if head != str(code)[: len(head)] or (payload and head != str(code)):
        raise ProtocolError(f"asked {code}, answered '{shown(text)}'")
    if len(text) > MAX_REPLY:
        raise ProtocolError(f"asked {code}, answered '{shown(text)}', without an end")
    if len(payload) < 2:
        return None
    flag, fields = payload[0], tuple(payload[1:])
    if flag not in {"0", "1"}:
        raise ProtocolError(f"asked {code}, answered '{shown(text)}': no ok flag")
    wanted = REPLY_FIELDS[code] if flag == "1" else 0
    if (wanted == 0 and fields != ("",)) or len(fields) > max(wanted, 1):
        raise ProtocolError(f"asked {code}, answered '{shown(text)}': more than {wanted} fields")
    if wanted == 0:
        return Reply(code, flag == "1", ())
    if len(fields) < wanted or fields[-1] in {"", "-"}:
        return None
    return Reply(code, True, fields)


def drop_stale(text: str, code: int) -> str:
    """Removes complete acknowledgements of other codes from the start of `text`; returns the rest.

    A server whose client vanished during a move sends that move's acknowledgement to the next client.
    """
    while True:
        head, *rest = text.split(" ", 2)
        if len(rest) < 2 or head == str(code) or not head.isdecimal() or rest[0] not in {"0", "1"}:
            return text
        if REPLY_FIELDS.get(int(head), 0) != 0 and rest[0] == "1":
            return text
        text = rest[1]


def parse_numbers(reply: Reply) -> tuple[float, ...]:
    """Parses the fields of a reply as numbers.

    A reply to READ_JOINTS has six angles in degrees. A reply to READ_POSE has a place in mm and a quaternion.

    Raises:
        ProtocolError: a field is not a finite number.
    """
    text = shown(" ".join(reply.fields))
    try:
        values = tuple(float(field) for field in reply.fields)
    except ValueError as error:
        raise ProtocolError(f"reply to {reply.code} with a garbled number: {text}") from error
    if not all(map(math.isfinite, values)):
        raise ProtocolError(f"reply to {reply.code} with a number that is not finite: {text}")
    return values
