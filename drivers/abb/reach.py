"""Checks motions before they are sent, since a controller may answer unreachable targets with silence."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

from drivers.abb import kinematics
from drivers.abb.codec import IDENTITY, Pose
from drivers.abb.kinematics import LAST_AXIS_DEG, compose, invert
from drivers.errors import PortError

STEP_MM = 50.0  # distance between checked points of a straight path
SPARE_DEG = 10.0  # margin at both ends of the last axis's range
# The same margin if the base is unknown: axis 1, which also turns the hand, turns by less than this in a
# work area.
SPARE_BLIND_DEG = 90.0

UNIT = 1e-3  # largest difference of a quaternion's length from 1

Box = tuple[float, float, float, float, float, float]  # mm: least x, y, z, then greatest x, y, z


class Setup(NamedTuple):
    """Frames and limits of an arm, and whether motions are allowed."""

    # tool frame in the flange frame: the point midway between the finger tips, z out of the flange
    tool: Pose = IDENTITY
    work_object: Pose = IDENTITY  # the table's frame in the arm's world frame
    # the arm's base frame in its world frame; None: unknown, the reach is then not checked
    base: Pose | None = None
    # box of the hand in the work object frame; None: only the reach limits it
    area: Box | None = None
    # least and greatest angle of the last axis, deg: the arm's own, or what the cables allow
    wrist: tuple[float, float] = LAST_AXIS_DEG
    # largest distance of the flange from the base, for unknown kinematics; mm
    reach_mm: float = math.inf
    # whether the driver sends no setting and no motion; poses are then in the frames set in the server
    read_only: bool = False

    @property
    def table(self) -> Pose:
        """The table's frame in the arm's base frame, or in the arm's world frame if the base is unknown."""
        return compose(invert(self.base or IDENTITY), self.work_object)

    def hand_at(self, flange: Pose) -> Pose:
        """Converts a pose of the flange in the base frame to the pose of the hand in the table's frame."""
        return compose(invert(self.table), compose(flange, self.tool))


def setup_of(url: str, *, read_only: bool) -> Setup:
    """Parses the frames and limits that follow the `?` in the address of an arm.

    Raises:
        PortError: a setting is invalid, stated twice, or without effect.
    """
    settings: dict[str, Any] = {}
    stated = parse_qsl(url.partition("?")[2], keep_blank_values=True)
    for name, text in stated:
        try:
            numbers = [float(number) for number in text.split(",")]
        except ValueError:
            numbers = []
        if not all(map(math.isfinite, numbers)) or not _is_sound(name, numbers):
            numbers = []
        if [other for other, _ in stated].count(name) > 1:
            raise PortError(f"arm {url}: {name} is stated twice; state it once")
        if name in {"tool", "work_object", "base"} and len(numbers) in {3, 7}:
            length = math.hypot(*numbers[3:])
            rotation = tuple(number / length for number in numbers[3:]) or IDENTITY.rotation
            settings[name] = Pose(numbers[0], numbers[1], numbers[2], rotation)  # type: ignore[arg-type]
        elif (name, len(numbers)) in {("area", 6), ("wrist", 2)}:
            settings[name] = tuple(numbers)
        elif (name, len(numbers)) == ("reach", 1):
            settings["reach_mm"] = numbers[0]
        else:
            raise PortError(
                f"arm {url}: {name}={text} is not understood; tool, work_object and base take x,y,z in mm "
                "(and a quaternion w,x,y,z), area takes x,y,z,x,y,z, the least ones first, wrist the last "
                "axis's range in degrees, reach mm from the base"
            )
    if "reach_mm" in settings and "base" not in settings:
        raise PortError(f"arm {url}: reach counts from the base; state base, too")
    return Setup(**settings, read_only=read_only)


def _is_sound(name: str, numbers: list[float]) -> bool:
    """Whether limits are in order, and a quaternion has the length 1."""
    if name in {"area", "wrist"}:
        half = len(numbers) // 2
        return all(low < high for low, high in zip(numbers[:half], numbers[half:], strict=False))
    if name == "reach":
        return all(number > 0.0 for number in numbers)
    return len(numbers) != 7 or abs(math.hypot(*numbers[3:]) - 1.0) < UNIT


def within_irb_120(flange: Pose) -> bool:
    """Whether an IRB 120-3/0.58 can bring its flange to a pose in its base frame."""
    return kinematics.inverse(flange) is not None


def within_sphere(setup: Setup) -> Callable[[Pose], bool]:
    """Returns a function that says whether a pose of the flange is within `setup.reach_mm` of the base.

    The function is for arms other than the IRB 120: their kinematics are not modelled.
    """
    return lambda flange: math.dist(flange[:3], (0.0, 0.0, 0.0)) <= setup.reach_mm


def obstacle(start: Pose, target: Pose, setup: Setup, reaches: Callable[[Pose], bool]) -> str:
    """Returns why the hand cannot move straight from `start` to `target`; an empty string if it can.

    Args:
        start: pose of the hand in the work object frame.
        target: pose in the same frame; it has to be within the work area, unlike `start`.
        setup: frames and limits.
        reaches: says whether the flange can be at a pose in the base frame; not used if the base is unknown.
    """
    if setup.area is not None:
        low, high = setup.area[:3], setup.area[3:]
        if not all(a <= value <= b for a, value, b in zip(low, target[:3], high, strict=True)):
            return f"outside the work area {_text(low)} to {_text(high)} mm"
    if setup.base is None:
        return ""
    table, from_tool = setup.table, invert(setup.tool)
    points = max(math.ceil(math.dist(start[:3], target[:3]) / STEP_MM), 1)
    for number in range(points, 0, -1):
        tip = kinematics.between(start, target, number / points)
        if not reaches(compose(compose(table, tip), from_tool)):
            return f"out of the arm's reach at {_text(tip[:3])} mm"
    return ""


class Wrist(NamedTuple):
    """Latest reading of the joints; predicts which angles of the hand the last axis allows at a place.

    The hand points down. Its angle grows with the angle of axis 1, which points up, and falls with the angle
    of the last axis, which points down. So the sum of hand angle and last axis changes only with axis 1.
    """

    whole_rad: float  # sum of hand angle and last axis, whole turns counted
    x_mm: float  # place of the hand at that reading, in the work object frame
    y_mm: float

    def moved(self, x_mm: float, y_mm: float, setup: Setup) -> float:
        """Predicts the sum of hand angle and last axis at a place, rad.

        If the base is unknown, returns the sum of the last reading.
        """
        if setup.base is None:
            return self.whole_rad
        turn = _bearing(x_mm, y_mm, setup) - _bearing(self.x_mm, self.y_mm, setup)
        return self.whole_rad + math.remainder(turn, math.tau)

    def turn_range(self, x_mm: float, y_mm: float, setup: Setup) -> tuple[float, float]:
        """Least and greatest angle of the hand at a place, rad; between them the last axis stays in range."""
        spare = SPARE_DEG if setup.base is not None else SPARE_BLIND_DEG
        whole = self.moved(x_mm, y_mm, setup)
        low, high = setup.wrist
        return whole - math.radians(high - spare), whole - math.radians(low + spare)


def _bearing(x_mm: float, y_mm: float, setup: Setup) -> float:
    """Angle of axis 1 that puts the hand at a place, rad; assumes that the tool lies on the last axis."""
    seen = compose(setup.table, Pose(x_mm, y_mm, 0.0, IDENTITY.rotation))
    return math.atan2(seen.y_mm, seen.x_mm)


def _text(place: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in place) + ")"
