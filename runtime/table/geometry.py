"""Computes with planar poses in mm and rad, such as a change of frame, and with the outlines of parts."""

from collections.abc import Sequence
from math import cos, degrees, fsum, hypot, remainder, sin, sqrt, tau

from runtime.table.model import Place, Push, Squeeze

Pose2 = tuple[float, float, float]  # x mm, y mm, theta rad
Outline = Sequence[tuple[float, float]]  # vertices, counter-clockwise about the origin, mm
MOST_TURNS = 3  # more than any wrist turns


def pose_text(pose: Pose2) -> str:
    """A pose for people: "(1.00, -2.00) mm, 30.0 deg"."""
    return f"({pose[0]:.2f}, {pose[1]:.2f}) mm, {degrees(pose[2]):z.1f} deg"


def placement(action: Squeeze | Push, released: Place | None = None) -> Pose2:
    """Pose of the hand in the world, mm, mm, rad, at which it comes down for a squeeze or a push.

    If `released` is given, it is the place to which the hand drags the part. The result is then the pose of
    the hand there, at which it releases the part.
    """
    place = released or action
    return place.x_um / 1000, place.y_um / 1000, action.angle_urad / 1e6


def end_of(push: Push) -> Pose2:
    """Pose of the hand in the world, mm, mm, rad, at the end of a push."""
    return compose(placement(push), (push.length_um / 1000, 0.0, 0.0))


def compose(frame: Pose2, pose: Pose2) -> Pose2:
    """Converts a pose relative to `frame` to the coordinates in which `frame` itself is stated."""
    x, y, theta = pose
    c, s = cos(frame[2]), sin(frame[2])
    return frame[0] + c * x - s * y, frame[1] + s * x + c * y, frame[2] + theta


def turned_pose(pose: Pose2, turn_rad: float) -> Pose2:
    """A pose turned about the origin by `turn_rad`; its angle is within -pi to pi."""
    x, y, theta = compose((0.0, 0.0, turn_rad), pose)
    return x, y, remainder(theta, tau)


def way(start: Pose2, end: Pose2) -> tuple[float, float]:
    """Distance and turn from one pose to another, mm and rad."""
    return hypot(end[0] - start[0], end[1] - start[1]), remainder(end[2] - start[2], tau)


def sent(hand: Pose2, middle_mm: float) -> Pose2:
    """Pose to which the arm is sent so that the fingers meet at the pose `hand`.

    The fingers meet `middle_mm` off the hand's middle, along the hand's y.
    """
    return compose(hand, (0.0, -middle_mm, 0.0))


def same_turns(angle_rad: float, low_rad: float, high_rad: float, near_rad: float) -> list[float]:
    """The angles within a range that equal an angle up to whole turns, the nearest to `near_rad` first."""
    nearest = angle_rad + tau * round((near_rad - angle_rad) / tau)
    turns = (nearest + tau * number for number in range(-MOST_TURNS, MOST_TURNS + 1))
    results = [turn for turn in turns if low_rad <= turn <= high_rad]
    return sorted(results, key=lambda turn: abs(turn - near_rad))


def from_segment(
    point: tuple[float, float], start: tuple[float, float], end: tuple[float, float]
) -> float:
    """The distance of a point from the straight segment between `start` and `end`, in their unit."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    px, py = point[0] - start[0], point[1] - start[1]
    along = (px * dx + py * dy) / max(dx * dx + dy * dy, 1e-18)
    share = min(max(along, 0.0), 1.0)
    return hypot(px - share * dx, py - share * dy)


def gyration_mm(outline: Outline) -> float:
    """The radius of gyration, mm, about the origin, of the area inside an outline; 0 for an empty area."""
    crosses, moments = [], []
    for (x0, y0), (x1, y1) in zip(outline, (*outline[1:], *outline[:1]), strict=True):
        cross = x0 * y1 - x1 * y0
        crosses.append(cross)
        moments.append(cross * (x0 * x0 + x0 * x1 + x1 * x1 + y0 * y0 + y0 * y1 + y1 * y1))
    area = 6.0 * fsum(crosses)
    return sqrt(max(fsum(moments) / area, 0.0)) if area > 0.0 else 0.0
