"""The hand: arm and gripper moved together, one checked motion after the other.

No motion is commanded before the gripper has answered that it is ready and the arm that it stands where its
last motion left it. Between two squeezes the hand retreats straight up, travels, and comes straight down.

The arm is read before and after each of its motions and after each squeeze, and compared with where it was
sent (`safety.check_placed`): what displaced it may have moved the part, too.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil, degrees, remainder, tau

from drivers.ports import Arm, Gripper, PoseOfHand, Settled
from runtime.devices.clock import SystemClock
from runtime.errors import MotionRefusedError
from runtime.execution import safety, strokes
from runtime.execution.handling import CLEAR_MM, Handling, check_arc
from runtime.execution.reading import (
    CLOSED_COUNTS,
    check_closed,
    check_fresh,
    check_opened,
    check_passed,
    check_set,
)
from runtime.execution.strokes import Stroke
from runtime.execution.watch import ARM, GRIPPER, Watch
from runtime.table import Limits, Node, Push, Squeeze, Table, profile_of
from runtime.traversal.decision import ARRIVED, CLOSING_CONTACT
from runtime.traversal.geometry import end_of, placement, same_turns, sent

# Nearer than this to a height the arm counts as standing there.
LEVEL_MM = 0.05
# How long a motion begun before a crash may still take (full stroke at the slowest speed, and some).
STILL_S = 8.0
MOST_TURN_RAD = 2.5
LOOK_S = 0.05


class Hand:
    """Arm and gripper of one cell, connected, within one table's limits.

    Its `calibration` is that of counts to widths. `arm_known` tells whether the arm stands where its last
    acknowledged motion left it, or, before its first one, where it was read first; `may_hold` whether the
    fingers may hold something: they have not opened since they closed, or since the hand was made. All its
    places are those where the fingers meet: the arm is sent beside them where that is off its own middle.

    Raises:
        TableError: the limits leave no room for the tips' arc.
    """

    def __init__(
        self, gripper: Gripper, arm: Arm, clock: SystemClock, table: Table, handling: Handling
    ) -> None:
        self.watch = Watch(clock)
        self.gripper, self.arm = self.watch.watched(gripper, GRIPPER), self.watch.watched(arm, ARM)
        self.limits = table.limits
        self.calibration = handling.widths(table)
        self.middle_mm = handling.middle_mm
        self._profile = profile_of(table.gripper.model)
        self.arm_known = self.may_hold = True
        self._clock = clock
        self._handling = handling
        self._open_mm = 0.0
        check_arc(handling.arc, table.limits, self.calibration)
        self._sent_to: PoseOfHand | None = None  # where the arm should stand, None where nobody knows

    def await_stillness(self) -> None:
        """Wait until a motion that was begun before this run is over.

        Raises:
            GripperStateError: the fingers do not come to rest, or are not ready.
        """
        until = self._clock.now() + STILL_S
        while self.gripper.state().moving and self._clock.now() < until:
            self._clock.sleep(LOOK_S)
        safety.ready_gripper(self.gripper)

    def where(self) -> PoseOfHand:
        """Read where the arm stands.

        Raises:
            MotionRefusedError: something else than its last motion brought it there.
        """
        self.arm_known = False  # until it answers
        pose = self.arm.pose() if self._sent_to is None else safety.check_placed(self.arm, self._sent_to)
        self._sent_to = self._sent_to or pose
        self.arm_known = True
        return _beside(pose, -self.middle_mm)

    def retreat(self) -> None:
        """Go straight up, from wherever the arm stands; nothing to do if it is up already."""
        safety.ready_gripper(self.gripper)
        x_mm, y_mm, z_mm, angle_rad = self._place()
        height_mm = self.limits.retreat_height_um / 1000
        if z_mm < height_mm - LEVEL_MM:
            self._move_arm((x_mm, y_mm, height_mm, angle_rad))

    def travel(self, x_mm: float, y_mm: float, angle_rad: float) -> None:
        """Go to a place at the retreat height, turning the nearest way that the wrist can go.

        Raises:
            MotionRefusedError: the place is outside the area, or the wrist cannot be turned so far.
        """
        self.arm_known = False  # until it answers
        low_rad, high_rad = self.arm.turn_range(x_mm, y_mm)
        self.arm_known = True
        turns = same_turns(angle_rad, low_rad, high_rad, self._place()[3])
        if not turns:
            raise MotionRefusedError(
                f"the wrist cannot turn the hand to {degrees(angle_rad):.1f} deg at ({x_mm:.2f}, {y_mm:.2f}) "
                f"mm, only to {degrees(low_rad):.0f}..{degrees(high_rad):.0f} deg"
            )
        self.travel_as_counted(x_mm, y_mm, turns[0])

    def travel_as_counted(self, x_mm: float, y_mm: float, angle_rad: float) -> None:
        """Go to a place at the retreat height, whole turns of the angle counted."""
        self._go_as_counted((x_mm, y_mm, self.limits.retreat_height_um / 1000, angle_rad))

    def descend(self, x_mm: float, y_mm: float, angle_rad: float) -> None:
        """Come straight down with the jaws open, the tips to the squeeze height."""
        self.lower(x_mm, y_mm, angle_rad, self._open_mm)

    def lower(self, x_mm: float, y_mm: float, angle_rad: float, width_mm: float) -> None:
        """Come straight down with a part of that width in the fingers."""
        arc = self._handling.arc
        advance_mm = 0.0 if arc is None else arc.advance_mm(width_mm)
        self._go((x_mm, y_mm, self._low_mm(advance_mm), angle_rad))

    def drag(self, x_mm: float, y_mm: float) -> None:
        """Take what the fingers hold along the table to another place, without turning it."""
        self._slide(x_mm, y_mm, self.limits.arm_speed_um_s)

    def push(self, push: Push) -> None:
        """Come down at the start of a push, with the jaws set for it, and go to its end.

        Raises:
            GripperStateError: the jaws do not stand as they were set any more.
        """
        self.descend(*placement(push))
        self._slide(*end_of(push)[:2], push.speed_um_s)
        count = self.gripper.state().position_counts
        check_set(count, self.calibration.count(push.opening_um), self.calibration)

    def _slide(self, x_mm: float, y_mm: float, speed_um_s: int) -> None:
        _, _, z_mm, angle_rad = self._place()
        # An arm that was only read may stand below the squeeze height by what its reading is rounded.
        self._go((x_mm, y_mm, max(z_mm, self._low_mm(0.0)), angle_rad), speed_um_s)

    @contextmanager
    def limited(self, limits: Limits) -> Iterator[None]:
        """Within the context other limits hold: those of a delivery."""
        before, self.limits = self.limits, limits
        try:
            yield
        finally:
            self.limits = before

    def width_mm(self, position_counts: int) -> float:
        """The opening at an encoder count."""
        return self.calibration.width_um(position_counts) / 1000

    def open(self, squeeze: Squeeze) -> None:
        """Open the jaws as wide as the squeeze wants them; the collision proof counts on it."""
        request = strokes.opening_counts(squeeze.opening_um, self.calibration)
        speed = self._profile.speed_counts(squeeze.speed_um_s)
        force = self._profile.force_counts(squeeze.force_mn)
        settled = safety.stroke(self.gripper, request, speed, force)
        check_opened(settled, request, self.calibration)
        self.may_hold = False
        self._open_mm = self.width_mm(settled.position_counts)

    def set_jaws(self, push: Push, squeeze: Squeeze) -> None:
        """Bring the jaws, with nothing between them, to the opening of a push before a squeeze."""
        request, profile = self.calibration.count(push.opening_um), self._profile
        speed, force = profile.speed_counts(squeeze.speed_um_s), profile.force_counts(squeeze.force_mn)
        settled = safety.stroke(self.gripper, request, speed, force)
        check_fresh(settled, request)
        check_set(settled.position_counts, request, self.calibration)
        self._open_mm = self.width_mm(settled.position_counts)

    def release(self, squeeze: Squeeze) -> None:
        """Open the jaws at the part; the tips stay level until they are clear of its sides."""
        self.where()  # a part that was displaced with the hand is not let go
        arc = self._handling.arc
        if arc is not None:
            held_mm = self.width_mm(self.gripper.state().position_counts)
            clear_mm = min(held_mm + CLEAR_MM, squeeze.opening_um / 1000)
            widths = [*arc.stages(clear_mm, held_mm)[-2::-1], clear_mm]
            for width_mm in widths:
                self.open(squeeze._replace(opening_um=round(1000 * width_mm)))
                self._level(arc.advance_mm(self._open_mm))
        self.open(squeeze)

    def close(self, node: Node) -> Settled:
        """Close the jaws at a node.

        Returns:
            The last stroke's reading, of jaws that closed where the arm was sent.

        Raises:
            GripperStateError: it is not fresh, or contradicts itself.
            MotionRefusedError: the arm was displaced meanwhile.
        """
        handling, profile = self._handling, self._profile
        regulated = strokes.is_regulated(node.squeeze, profile, wanted=handling.regulated)
        plan = strokes.closing(
            node, profile, self.calibration, handling.arc, self._open_mm, regulated=regulated
        )
        for stroke in plan[:-1]:
            self._level(stroke.advance_mm)
            if not check_passed(self._stroke(stroke), stroke.request_counts, self.calibration):
                break
        else:
            self._level(plan[-1].advance_mm)
        reading = self._stroke(plan[-1])
        check_fresh(reading, CLOSED_COUNTS)
        if regulated and reading.object_flag == CLOSING_CONTACT:
            reading = self._raise_force(plan[-1], node.squeeze, reading)
        self.where()
        check_closed(reading, self.calibration, handling.current_ma)
        return reading

    def _raise_force(self, stroke: Stroke, squeeze: Squeeze, reading: Settled) -> Settled:
        limit_ma = self._handling.grip_current_ma
        for force in strokes.raising(squeeze, self._profile):
            if limit_ma is not None and reading.current_ma >= limit_ma:
                break
            reading = self._stroke(stroke._replace(force_counts=force))
            check_fresh(reading, CLOSED_COUNTS)
            if reading.object_flag == ARRIVED:  # it slipped out: the width tells
                break
        return reading

    def _stroke(self, stroke: Stroke) -> Settled:
        self.may_hold = True
        return safety.stroke(self.gripper, stroke.request_counts, stroke.speed_counts, stroke.force_counts)

    def _level(self, advance_mm: float) -> None:
        """Bring the arm to the height at which tips that advance so far are at the squeeze height."""
        if self._handling.arc is None:
            return
        x_mm, y_mm, z_mm, angle_rad = self._place()
        height_mm = self._low_mm(advance_mm)
        if abs(height_mm - z_mm) > LEVEL_MM:
            self._go((x_mm, y_mm, height_mm, angle_rad))

    def _go(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        """Go to a place by the smallest turn of the hand."""
        now_rad = self._place()[3]
        self._go_as_counted((*target[:3], now_rad + remainder(target[3] - now_rad, tau)), speed_um_s)

    def _go_as_counted(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        """Go straight to a place, in several motions where the hand turns by about half a turn or more.

        At the arm's speed, unless another is stated.
        """
        safety.check_target(_beside(target, self.middle_mm), self.limits)
        start = self._place()
        motions = ceil(abs(target[3] - start[3]) / MOST_TURN_RAD)
        for number in range(1, motions):
            x, y, z, angle = (a + (b - a) * number / motions for a, b in zip(start, target, strict=True))
            safety.ready_gripper(self.gripper)
            self._move_arm((x, y, z, angle), speed_um_s)
        safety.ready_gripper(self.gripper)
        self._move_arm(target, speed_um_s)

    def _place(self) -> PoseOfHand:
        """Where the arm was sent, else where it stands."""
        return self.where() if self._sent_to is None else _beside(self._sent_to, -self.middle_mm)

    def _move_arm(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        self.where()
        self.arm_known, self._sent_to = False, None  # until it is acknowledged; an interrupt leaves it so
        beside = _beside(target, self.middle_mm)
        self.arm.move_linear(*beside, (speed_um_s or self.limits.arm_speed_um_s) / 1000)
        safety.check_placed(self.arm, beside)
        self.arm_known, self._sent_to = True, beside

    def _low_mm(self, advance_mm: float) -> float:
        return self.limits.squeeze_height_um / 1000 + max(advance_mm, 0.0)


def _beside(place: PoseOfHand, middle_mm: float) -> PoseOfHand:
    """Where the arm has to stand for the fingers to meet at a place, so far off the hand's middle."""
    x_mm, y_mm, z_mm, angle_rad = place
    x_mm, y_mm, _ = sent((x_mm, y_mm, angle_rad), middle_mm)
    return x_mm, y_mm, z_mm, angle_rad
