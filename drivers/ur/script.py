"""Programs in URScript (Universal Robots' script manual) that the driver sends, and conversions of poses."""

import math

from drivers.abb.codec import Pose, Quaternion
from drivers.ur.rtde import DONE, STARTED, Vector

ACCELERATION_M_S2 = 0.5
STOP_M_S2 = 1.0


def move(number: int, tool: Pose, target: Pose, pacing: str) -> bytes:
    """Creates a program that moves the tool straight to a pose, and reports start and end in registers.

    Args:
        number: number of the move; one register holds it after the start, another after the end.
        tool: the tool's frame in the flange frame.
        target: pose of the tool in the base frame.
        pacing: arguments of `movel` for its speed.
    """
    return _program(
        f"set_tcp({pose(tool)})",
        f"write_output_integer_register({STARTED}, {number})",
        f"movel({pose(target)}, a={ACCELERATION_M_S2}, {pacing})",
        f"write_output_integer_register({DONE}, {number})",
    )


def stop() -> bytes:
    """Creates a program that brakes the arm; it replaces the running program."""
    return _program(f"stopl({STOP_M_S2})")


def pose(frame: Pose) -> str:
    """Formats a pose (mm, quaternion) as a URScript literal `p[...]`: m, and a rotation vector in rad."""
    numbers = (*(value / 1000.0 for value in frame[:3]), *rotation_vector(frame.rotation))
    return "p[" + ", ".join(f"{number:.7f}" for number in numbers) + "]"


def frame(vector: Vector) -> Pose:
    """Converts a pose of six numbers, m and a rotation vector, to mm and a quaternion."""
    x, y, z = (1000.0 * value for value in vector[:3])
    return Pose(x, y, z, rotation(vector[3:]))


def rotation_vector(turn: Quaternion) -> tuple[float, float, float]:
    """Converts a unit quaternion to axis times angle, rad; the angle is at most half a turn."""
    w, x, y, z = turn if turn[0] >= 0.0 else (-part for part in turn)
    length = math.hypot(x, y, z)
    scale = 2.0 if length == 0.0 else 2.0 * math.atan2(length, w) / length
    return scale * x, scale * y, scale * z


def rotation(vector: Vector) -> Quaternion:
    """Converts axis times angle, rad, to a unit quaternion."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    scale = 0.5 if angle == 0.0 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x, scale * y, scale * z


def _program(*lines: str) -> bytes:
    body = "".join(f"  {line}\n" for line in lines)
    return f"def squeezetree():\n{body}end\n".encode("ascii")
