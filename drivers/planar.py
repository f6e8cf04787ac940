"""Poses in the plane: x in mm, y in mm, angle in rad within half a turn."""

from math import cos, remainder, sin, tau

Pose2 = tuple[float, float, float]


def compose(a: Pose2, b: Pose2) -> Pose2:
    """Converts pose b from the frame at pose a to the frame in which a is given."""
    c, s = cos(a[2]), sin(a[2])
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], remainder(a[2] + b[2], tau))


def relative(a: Pose2, b: Pose2) -> Pose2:
    """Converts pose b, given in the same frame as pose a, to the frame at pose a."""
    c, s = cos(a[2]), sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return (c * x + s * y, c * y - s * x, remainder(b[2] - a[2], tau))
