"""Planar poses in mm and rad: from the hand's frame to the world's and back, and the goal's distance."""

from math import cos, hypot, remainder, sin, tau

from runtime.table import GoalSpec, Leaf, Squeeze

MOST_TURNS = 3  # no wrist turns farther round, and none is counted farther

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


def same_turns(angle_rad: float, low_rad: float, high_rad: float, near_rad: float) -> list[float]:
    """The angles within a range that are whole turns off an angle, the nearest to another one first."""
    nearest = angle_rad + tau * round((near_rad - angle_rad) / tau)
    turns = (nearest + tau * number for number in range(-MOST_TURNS, MOST_TURNS + 1))
    found = [turn for turn in turns if low_rad <= turn <= high_rad]
    return sorted(found, key=lambda turn: abs(turn - near_rad))


def goal_distance_mm(goal: GoalSpec, predicted: Pose2, true: Pose2) -> float:
    """sqrt(dx^2 + dy^2) + rho * dtheta, the angle's error counted under the part's symmetry (paper, VII).

    Args:
        goal: rho in um, and the symmetry.
        predicted: mm, mm, rad.
        true: mm, mm, rad.
    """
    turn = abs(remainder(predicted[2] - true[2], tau / goal.symmetry))
    return hypot(predicted[0] - true[0], predicted[1] - true[1]) + goal.rho_um / 1000 * turn


def poses_of(leaf: Leaf) -> list[Pose2]:
    """Where the part may lie at a leaf: the predicted pose, and those it cannot tell from it."""
    others = [(x_um / 1000, y_um / 1000, theta_urad / 1e6) for x_um, y_um, theta_urad in leaf.alternatives]
    return [predicted_pose(leaf), *others]


def error_mm(goal: GoalSpec, leaf: Leaf, true: Pose2) -> float | None:
    """How far off a leaf is, by the goal's distance; None where the goal asks for the orientation alone."""
    if goal.kind == "orientation":
        return None
    told = poses_of(leaf) if goal.kind == "modes" else [predicted_pose(leaf)]
    return min(goal_distance_mm(goal, pose, true) for pose in told)


def meets(goal: GoalSpec, leaf: Leaf, true: Pose2) -> bool:
    """Whether a leaf's prediction meets the goal.

    Args:
        goal: of any kind.
        leaf: the prediction.
        true: where the part lies, mm, mm, rad.
    """
    if goal.kind in ("pose", "modes"):
        distance_mm = error_mm(goal, leaf, true)
        return distance_mm is not None and distance_mm < goal.distance_um / 1000
    x, y, theta = predicted_pose(leaf)
    off = [abs(x - true[0]), abs(y - true[1]), abs(remainder(theta - true[2], tau / goal.symmetry))]
    bounds = [goal.tolerance[0] / 1000, goal.tolerance[1] / 1000, goal.tolerance[2] / 1e6]
    first = 2 if goal.kind == "orientation" else 0
    return all(value < bound for value, bound in zip(off[first:], bounds[first:], strict=True))
