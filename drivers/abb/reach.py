"""What is refused before it is sent: the controller answers an unreachable target with silence.

The reach is that of an IRB 120-3/0.58 whose base frame is known; the work area is a box in the work object
frame.
"""

import math
from typing import NamedTuple

from drivers.abb import kinematics
from drivers.abb.codec import IDENTITY, Pose
from drivers.abb.kinematics import compose, invert

STEP_MM = 50.0  # between the points at which a straight path is looked at

Box = tuple[float, float, float, float, float, float]  # mm: x, y, z from, x, y, z to


class Setup(NamedTuple):
    """Where things are, and whether they may be moved.

    Attributes:
        tool: tool frame in the flange frame: the point midway between the finger tips, z out of the flange.
        work_object: the table's frame in the arm's world frame.
        base: the arm's base frame in its world frame; None: not known, the reach is then not checked.
        area: what the hand may not leave, in the work object frame; None: only the reach limits it.
        read_only: send no setting and refuse every command; poses are then in the frames the server has.
    """

    tool: Pose = IDENTITY
    work_object: Pose = IDENTITY
    base: Pose | None = None
    area: Box | None = None
    read_only: bool = False


def obstacle(start: Pose, target: Pose, setup: Setup) -> str:
    """Why a straight way cannot be gone, or an empty string.

    Args:
        start: where the hand is, in the work object frame.
        target: where it is to go.
        setup: frames and limits.
    """
    if setup.area is not None:
        low, high = setup.area[:3], setup.area[3:]
        if not all(a <= value <= b for a, value, b in zip(low, target[:3], high, strict=True)):
            return f"outside the work area {_told(low)} to {_told(high)} mm"
    if setup.base is None:
        return ""
    to_base = compose(invert(setup.base), setup.work_object)
    from_tool = invert(setup.tool)
    points = max(math.ceil(math.dist(start[:3], target[:3]) / STEP_MM), 1)
    for number in range(points, 0, -1):
        tip = kinematics.between(start, target, number / points)
        if kinematics.inverse(compose(compose(to_base, tip), from_tool)) is None:
            return f"out of the arm's reach at {_told(tip[:3])} mm"
    return ""


def _told(place: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in place) + ")"
