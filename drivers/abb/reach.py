"""What is refused before it is sent: the controller answers an unreachable target with silence."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

from drivers.abb import kinematics
from drivers.abb.codec import IDENTITY, Pose
from drivers.abb.kinematics import LAST_AXIS_DEG, compose, invert
from drivers.errors import PortError

STEP_MM = 50.0  # between the points at which a straight path is looked at
SPARE_DEG = 10.0  # kept from both ends of the last axis's range
# Where the base is not known, nor is axis 1, which turns the hand too: by less than this across a work area.
SPARE_BLIND_DEG = 90.0

Box = tuple[float, float, float, float, float, float]  # mm: x, y, z from, x, y, z to


class Setup(NamedTuple):
    """Where things are, and whether they may be moved."""

    # tool frame in the flange frame: the point midway between the finger tips, z out of the flange
    tool: Pose = IDENTITY
    work_object: Pose = IDENTITY  # the table's frame in the arm's world frame
    # the arm's base frame in its world frame; None: not known, the reach is then not checked
    base: Pose | None = None
    # what the hand may not leave, in the work object frame; None: only the reach limits it
    area: Box | None = None
    # least and greatest angle of the last axis, deg: the arm's own, or what the cables allow
    wrist: tuple[float, float] = LAST_AXIS_DEG
    # how far from the base the flange may go, of an arm whose kinematics are not known here; mm
    reach_mm: float = math.inf
    # send no setting and refuse every command; poses are then in the frames the server has
    read_only: bool = False


def setup_of(url: str, *, read_only: bool) -> Setup:
    """The setup that an address states after its `?`.

    Raises:
        PortError: a setting is not understood.
    """
    settings: dict[str, Any] = {}
    for name, text in parse_qsl(url.partition("?")[2], keep_blank_values=True):
        try:
            numbers = [float(number) for number in text.split(",")]
        except ValueError:
            numbers = []
        if name in {"tool", "work_object", "base"} and len(numbers) in {3, 7}:
            rotation = tuple(numbers[3:]) or IDENTITY.rotation
            settings[name] = Pose(numbers[0], numbers[1], numbers[2], rotation)  # type: ignore[arg-type]
        elif (name, len(numbers)) in {("area", 6), ("wrist", 2)}:
            settings[name] = tuple(numbers)
        elif (name, len(numbers)) == ("reach", 1):
            settings["reach_mm"] = numbers[0]
        else:
            raise PortError(
                f"arm {url}: {name}={text} is not understood; tool, work_object and base take x,y,z in mm "
                "(and a quaternion w,x,y,z), area takes x,y,z,x,y,z, wrist the last axis's range in degrees, "
                "reach mm from the base"
            )
    return Setup(**settings, read_only=read_only)


def within_irb_120(flange: Pose) -> bool:
    """Whether an IRB 120-3/0.58 can bring its flange to a pose in its base frame."""
    return kinematics.inverse(flange) is not None


def within_sphere(setup: Setup) -> Callable[[Pose], bool]:
    """A stand-in for the kinematics of other arms: the flange within `reach_mm` of the base."""
    return lambda flange: math.dist(flange[:3], (0.0, 0.0, 0.0)) <= setup.reach_mm


def obstacle(
    start: Pose, target: Pose, setup: Setup, reaches: Callable[[Pose], bool] = within_irb_120
) -> str:
    """Why the hand cannot go a straight way in the work object frame, or an empty string.

    Where the base frame is known `reaches` says whether the flange can be at a pose there.
    """
    if setup.area is not None:
        low, high = setup.area[:3], setup.area[3:]
        if not all(a <= value <= b for a, value, b in zip(low, target[:3], high, strict=True)):
            return f"outside the work area {_text(low)} to {_text(high)} mm"
    if setup.base is None:
        return ""
    to_base = compose(invert(setup.base), setup.work_object)
    from_tool = invert(setup.tool)
    points = max(math.ceil(math.dist(start[:3], target[:3]) / STEP_MM), 1)
    for number in range(points, 0, -1):
        tip = kinematics.between(start, target, number / points)
        if not reaches(compose(compose(to_base, tip), from_tool)):
            return f"out of the arm's reach at {_text(tip[:3])} mm"
    return ""


class Wrist(NamedTuple):
    """How far round the wrist stood when the joints were last read.

    The angle of a hand that points down grows with axis 1, which looks up, and falls with the last axis,
    which looks down: but for axis 1, hand angle and last axis always add up to the same.
    """

    whole_rad: float  # hand angle and last axis added up, the angle counted on over whole turns
    x_mm: float  # where the hand was, work object frame
    y_mm: float

    def moved(self, x_mm: float, y_mm: float, setup: Setup) -> float:
        """What angle and last axis add up to at another place, rad; as here where the base is not known."""
        if setup.base is None:
            return self.whole_rad
        turn = _bearing(x_mm, y_mm, setup) - _bearing(self.x_mm, self.y_mm, setup)
        return self.whole_rad + math.remainder(turn, math.tau)

    def turn_range(self, x_mm: float, y_mm: float, setup: Setup) -> tuple[float, float]:
        """Least and greatest angle of the hand there at which the last axis keeps to its range, rad."""
        spare = SPARE_DEG if setup.base is not None else SPARE_BLIND_DEG
        whole = self.moved(x_mm, y_mm, setup)
        low, high = setup.wrist
        return whole - math.radians(high - spare), whole - math.radians(low + spare)


def _bearing(x_mm: float, y_mm: float, setup: Setup) -> float:
    """Where axis 1 looks when the hand is there, rad; the tool lies on the last axis, which points down."""
    assert setup.base is not None
    place = Pose(x_mm, y_mm, 0.0, IDENTITY.rotation)
    seen = compose(compose(invert(setup.base), setup.work_object), place)
    return math.atan2(seen.y_mm, seen.x_mm)


def _text(place: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in place) + ")"
