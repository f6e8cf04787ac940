"""Planar poses in mm and rad: from the hand's frame to the world's."""

from math import cos, sin, tau

from runtime.table import Place, Pose2, Push, Squeeze

MOST_TURNS = 3  # more than any wrist turns


def placement(action: Squeeze | Push, released: Place | None = None) -> Pose2:
    """Pose of the hand in the world, mm, mm, rad, where it comes down for an action.

    With `released`, the pose where it releases the part.
    """
    place = released or action
    return place.x_um / 1000, place.y_um / 1000, action.angle_urad / 1e6


def end_of(push: Push) -> Pose2:
    """Pose of the hand in the world, mm, mm, rad, at the end of a push."""
    return compose(placement(push), (push.length_um / 1000, 0.0, 0.0))


def compose(frame: Pose2, pose: Pose2) -> Pose2:
    """Transforms a pose given in `frame` to the frame that `frame` is given in."""
    x, y, theta = pose
    c, s = cos(frame[2]), sin(frame[2])
    return frame[0] + c * x - s * y, frame[1] + s * x + c * y, frame[2] + theta


def sent(hand: Pose2, middle_mm: float) -> Pose2:
    """Pose to which the arm is sent so that the fingers meet at `hand`.

    They meet `middle_mm` off the hand's middle, along its y.
    """
    return compose(hand, (0.0, -middle_mm, 0.0))


def same_turns(angle_rad: float, low_rad: float, high_rad: float, near_rad: float) -> list[float]:
    """The angles within a range that equal an angle up to whole turns, the nearest to `near_rad` first."""
    nearest = angle_rad + tau * round((near_rad - angle_rad) / tau)
    turns = (nearest + tau * number for number in range(-MOST_TURNS, MOST_TURNS + 1))
    results = [turn for turn in turns if low_rad <= turn <= high_rad]
    return sorted(results, key=lambda turn: abs(turn - near_rad))
