"""Planar poses in mm and rad: from the hand's frame to the world's."""

from math import cos, sin

from runtime.table import Pose2, Squeeze


def placement(squeeze: Squeeze) -> Pose2:
    """The hand frame in the world."""
    return squeeze.x_um / 1000, squeeze.y_um / 1000, squeeze.angle_urad / 1e6


def compose(frame: Pose2, pose: Pose2) -> Pose2:
    """A pose given in `frame`, in the frame that `frame` is given in."""
    x, y, theta = pose
    c, s = cos(frame[2]), sin(frame[2])
    return frame[0] + c * x - s * y, frame[1] + s * x + c * y, frame[2] + theta
