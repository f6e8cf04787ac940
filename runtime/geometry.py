"""Planar poses in mm and rad: from the hand's frame to the world's and back, and the goal's distance."""

from math import cos, hypot, remainder, sin, tau

from runtime.table import GoalSpec, Leaf, Squeeze

Pose2 = tuple[float, float, float]  # x mm, y mm, theta rad


def placement(squeeze: Squeeze) -> Pose2:
    """The hand frame in the world."""
    return squeeze.x_um / 1000, squeeze.y_um / 1000, squeeze.angle_urad / 1e6


def predicted_pose(leaf: Leaf) -> Pose2:
    """The part's pose in the world that a leaf predicts."""
    return leaf.x_um / 1000, leaf.y_um / 1000, leaf.theta_urad / 1e6


def compose(frame: Pose2, pose: Pose2) -> Pose2:
    """A pose given in `frame`, in the frame that `frame` is given in."""
    x, y, theta = pose
    c, s = cos(frame[2]), sin(frame[2])
    return frame[0] + c * x - s * y, frame[1] + s * x + c * y, frame[2] + theta


def relative(frame: Pose2, pose: Pose2) -> Pose2:
    """The inverse of `compose`: a pose seen from `frame`."""
    dx, dy = pose[0] - frame[0], pose[1] - frame[1]
    c, s = cos(frame[2]), sin(frame[2])
    return c * dx + s * dy, -s * dx + c * dy, pose[2] - frame[2]


def goal_distance_mm(goal: GoalSpec, predicted: Pose2, true: Pose2) -> float:
    """sqrt(dx^2 + dy^2) + rho * dtheta, the angle's error counted under the part's symmetry (paper, VII).

    Args:
        goal: rho in um, and the symmetry.
        predicted: mm, mm, rad.
        true: mm, mm, rad.
    """
    turn = abs(remainder(predicted[2] - true[2], tau / goal.symmetry))
    return hypot(predicted[0] - true[0], predicted[1] - true[1]) + goal.rho_um / 1000 * turn
