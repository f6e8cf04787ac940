"""The test of whether a part is located, shared by planner, cell and camera (paper, VII, eq. 9)."""

from math import hypot, remainder, tau

from runtime.table.geometry import Pose2
from runtime.table.model import GoalSpec, Leaf, LeafPose, Tolerance


def predicted_pose(leaf: Leaf) -> Pose2:
    """The part's pose in the world that a leaf predicts, mm and rad."""
    return _pose(leaf)


def poses_of(goal: GoalSpec, leaf: Leaf) -> list[Pose2]:
    """The poses of a leaf, mm and rad, any of which may be right: several only for goals of kind "modes"."""
    return [*map(_pose, _allowed(goal, leaf))]


def hypotheses_of(goal: GoalSpec, leaf: Leaf) -> tuple[int, ...]:
    """For each pose that `poses_of` returns, the index of the hypothesis to which it belongs."""
    return tuple(pose.hypothesis for pose in _allowed(goal, leaf))


def residual(goal: GoalSpec, predicted: Pose2, true: Pose2) -> Pose2:
    """True pose minus predicted pose, mm, mm, rad; the angle is the smallest that the symmetry allows."""
    turn = remainder(true[2] - predicted[2], tau / goal.symmetry)
    return true[0] - predicted[0], true[1] - predicted[1], turn


def error_mm(goal: GoalSpec, predicted: Pose2, true: Pose2) -> float:
    """Error of a predicted pose, mm (eq. 9): sqrt(dx^2 + dy^2) + rho * abs(dtheta), for any kind of goal."""
    x, y, turn = residual(goal, predicted, true)
    return hypot(x, y) + goal.rho_um / 1e3 * abs(turn)


def distance(goal: GoalSpec, predicted: Pose2, true: Pose2) -> float:
    """Error of a predicted pose in the goal's metric; the goal is met if it is below `threshold`.

    For the kinds "pose" and "modes" it is `error_mm`; for "identity" it is 0; for other kinds it is the
    largest ratio of a coordinate's deviation to its tolerance.
    """
    if goal.kind in ("pose", "modes"):
        return error_mm(goal, predicted, true)
    if goal.kind == "identity":
        return 0.0
    first = 2 if goal.kind == "orientation" else 0
    off, tolerance = residual(goal, predicted, true)[first:], _pose(goal.tolerance)[first:]
    return max(abs(value) / most for value, most in zip(off, tolerance, strict=True))


def threshold(goal: GoalSpec) -> float:
    """The limit of `distance` below which a goal is met.

    It is `distance_um`, in mm, for the kinds "pose" and "modes", and 1 for all others.
    """
    return goal.distance_um / 1e3 if goal.kind in ("pose", "modes") else 1.0


def meets(goal: GoalSpec, leaf: Leaf, true: Pose2, hypothesis: int = 0) -> bool:
    """Whether a part at the pose `true` (mm, mm, rad) meets the goal at a leaf.

    The leaf must also state the part's `hypothesis` if the goal asks to identify the part.
    """
    return any(
        distance(goal, pose, true) < threshold(goal) and (which == hypothesis or not goal.identify)
        for pose, which in zip(poses_of(goal, leaf), hypotheses_of(goal, leaf), strict=True)
    )


def _allowed(goal: GoalSpec, leaf: Leaf) -> tuple[LeafPose, ...]:
    return leaf.poses if goal.kind == "modes" else leaf.poses[:1]


def _pose(pose: Leaf | LeafPose | Tolerance) -> Pose2:
    return pose.x_um / 1e3, pose.y_um / 1e3, pose.theta_urad / 1e6
