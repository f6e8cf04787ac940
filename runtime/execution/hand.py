"""The hand: arm and gripper moved together, one checked motion after the other.

No motion is commanded before the gripper has reported that it is ready, and the arm has reported that it
stands where its last motion left it. Between two squeezes the hand goes straight up, travels, and comes
straight down. Jaws that are clear of the part may continue to open while the hand goes up and travels, but
must stand open before the hand comes down.

The arm is read before and after each of its motions and after each squeeze, and its place is compared with
where it was sent (`safety.check_placed`): what displaced the arm may have moved the part, too.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import ceil, copysign, degrees, hypot, isinf, pi, remainder, tau

from drivers.ports import TURN_RADIUS_MM, Arm, Gripper, ObjectState, PoseOfHand, Settled
from runtime.devices.clock import SystemClock
from runtime.errors import MotionRefusedError
from runtime.execution import safety, strokes
from runtime.execution.handling import Handling, check_arc
from runtime.execution.jaws import Jaws
from runtime.execution.reading import CLOSED_UM, check_closed, check_fresh, check_set
from runtime.execution.watch import ARM, GRIPPER, Watch
from runtime.table import CLEAR_MM, Limits, Node, Push, Squeeze, Table, job_of, may_turn
from runtime.table.geometry import end_of, placement, same_turns, sent
from runtime.table.schedule import Schedule, close_alike

# Distance from a height within which the arm counts as standing there.
LEVEL_MM = 0.05
# Longest remaining time of a motion begun before a crash (full stroke at the slowest speed, and a
# margin).
STILL_S = 8.0
MOST_TURN_RAD = 2.5  # largest turn in one motion of the arm
SAVED_RAD = 0.2  # least effort, see `Hand.turn_to`, that half a turn of the hand must save
LOOK_S = 0.05  # time between two readings of a gripper that should come to rest


class Hand:
    """Arm and gripper of one cell, connected, within one table's limits.

    `calibration` converts nominal to true widths. `arm_known` states whether the arm stands where its last
    acknowledged motion left it or, before the first motion, where it was first read. A place that a method
    takes or returns is the place where the fingers meet, not the place of the arm.

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
        self.arm_known = True
        self._clock = clock
        self._handling = handling
        schedule = Schedule.of(table, job_of(table))
        check_arc(handling.arc, table.limits, self.calibration)
        self.timing = handling.lifted(schedule.timing, self.calibration)
        self._half_turn = pi if close_alike(table) else tau
        self._off_rad = 0.0  # angle of the hand beyond the plan's angle: 0 or half a turn
        self._may_turn = may_turn(table, job_of(table), self.middle_mm)
        self.jaws = Jaws(self.gripper, clock, self.calibration, self.timing)
        # where the arm should stand, None: unknown
        self._sent_to: PoseOfHand | None = None

    def await_stillness(self) -> None:
        """Waits until the fingers end a motion that began before this run.

        Raises:
            GripperStateError: the fingers do not come to rest, or the gripper is not ready.
        """
        until = self._clock.now() + STILL_S
        while self.gripper.state().moving and self._clock.now() < until:
            self._clock.sleep(LOOK_S)
        self.jaws.ready()

    def where(self) -> PoseOfHand:
        """Reads the arm; returns the place where the fingers meet.

        Raises:
            MotionRefusedError: the arm does not stand where its last motion left it.
        """
        self.arm_known = False  # until it answers
        sent_to = self._sent_to
        pose = self.arm.pose() if sent_to is None else safety.check_placed(self.arm, sent_to)
        self._sent_to = sent_to or pose
        self.arm_known = True
        return _beside(pose, -self.middle_mm)

    def turn_of_plan(self, first: Squeeze) -> float:
        """Angle, rad, by which to turn a part's plan about the origin so that `first` has the hand's angle.

        The hand then need not turn for `first`, the plan's first squeeze. The result is 0 where the table
        does not allow a turn, or the wrist's range is less than one and a half turns.
        """
        if not self._may_turn:
            return 0.0
        x_mm, y_mm, _, angle_rad = self._place()
        low_rad, high_rad = self._turn_range(x_mm, y_mm)
        if high_rad - low_rad < tau + pi:
            return 0.0
        return remainder(angle_rad - placement(first)[2], tau)

    def retreat(self) -> None:
        """Moves straight up to the retreat height; does nothing if the arm is there already."""
        self._rise(self.limits.retreat_height_um / 1000)

    def rise(self) -> None:
        """Moves straight up to the height at which the hand travels between two squeezes of one part."""
        self._rise(self.timing.regrasp_mm)

    def _rise(self, height_mm: float) -> None:
        x_mm, y_mm, z_mm, angle_rad = self._place()
        if z_mm < height_mm - LEVEL_MM:
            self.jaws.ready()
            self._move_arm((x_mm, y_mm, height_mm, angle_rad))

    def turn_to(self, x_mm: float, y_mm: float, angle_rad: float, *, first: bool) -> float:
        """Chooses the angle to which the hand turns for a squeeze, within the wrist's range.

        The wrist's range has ends, and the wrist may reach the planned angle in several ways, which differ by
        whole turns. Usually the shortest way from the present angle is chosen. The hand turns to another
        angle instead, half a turn off the planned one, in two cases:

        - The wrist cannot reach the planned angle; or it has to turn by more than half a turn to reach it,
          and the other angle costs less.
        - The hand is in the outer half of the wrist's range; the turn to the other angle leads away from the
          nearer end of the range, and costs less by more than `SAVED_RAD`.

        The cost is the angle by which the hand turns, times a weight. The nearer the hand is to an end of the
        range, the greater is the weight of a turn towards this end, and the smaller that of a turn back.

        If the table's fingers do not close alike, the other angle is a whole turn off the planned one. If
        they close alike in the table but not in the cell, a part squeezed half a turn off ends elsewhere than
        planned.

        After this choice, the planned angles of the part's later squeezes are turned by as much.

        Args:
            x_mm: x of the squeeze.
            y_mm: y of the squeeze.
            angle_rad: the planned angle.
            first: whether it is the part's first squeeze.

        Returns:
            The chosen angle, rad; `angle_rad` itself if the wrist can reach neither angle.
        """
        self._off_rad = 0.0 if first else self._off_rad
        low_rad, high_rad = self._turn_range(x_mm, y_mm)
        near_rad = self._place()[3]
        outward = _outward(near_rad, low_rad, high_rad)

        def effort(turn: float) -> float:
            return abs(turn - near_rad) + outward * (turn - near_rad)

        kept_rad = angle_rad + self._off_rad
        kept = same_turns(kept_rad, low_rad, high_rad, near_rad)[:1]
        turned = same_turns(kept_rad + self._half_turn, low_rad, high_rad, near_rad)
        if kept and abs(kept[0] - near_rad) <= pi:
            back = [turn for turn in turned if outward * (turn - near_rad) < 0.0]
            turned = [turn for turn in back if effort(turn) + SAVED_RAD < effort(kept[0])]
        turn = min([*kept, *turned], key=effort, default=angle_rad)
        if turn in turned:
            self._off_rad = self._half_turn - self._off_rad
        return turn

    def _turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        self.arm_known = False  # until it answers
        bounds = self.arm.turn_range(x_mm, y_mm)
        self.arm_known = True
        return bounds

    def travel(
        self, x_mm: float, y_mm: float, angle_rad: float, *, to_squeeze: bool = False
    ) -> None:
        """Travels to a place; of the angles equal up to whole turns, the hand takes the nearest.

        The hand travels at the height of `rise` if it stands there already, else at the retreat height; with
        `to_squeeze` it may descend to the height of `rise` on the way to a near place.

        Raises:
            MotionRefusedError: the place is outside the area, or the wrist cannot be turned so far.
        """
        low_rad, high_rad = self._turn_range(x_mm, y_mm)
        turns = same_turns(angle_rad, low_rad, high_rad, self._place()[3])
        if not turns:
            raise MotionRefusedError(
                f"the wrist cannot turn the hand to {degrees(angle_rad):.1f} deg at ({x_mm:.2f}, {y_mm:.2f}) "
                f"mm, only to {degrees(low_rad):.0f}..{degrees(high_rad):.0f} deg"
            )
        self.travel_as_counted(x_mm, y_mm, turns[0], to_squeeze=to_squeeze)

    def travel_as_counted(
        self, x_mm: float, y_mm: float, angle_rad: float, *, to_squeeze: bool = False
    ) -> None:
        """Travels to a place like `travel`, but to the angle as given, whole turns included."""
        low_mm, high_mm = self.timing.regrasp_mm, self.limits.retreat_height_um / 1000
        from_x_mm, from_y_mm, from_z_mm, from_rad = self._place()
        risen = abs(from_z_mm - low_mm) <= LEVEL_MM
        if to_squeeze:
            way_mm = hypot(x_mm - from_x_mm, y_mm - from_y_mm)
            risen = risen or self.timing.comes_down(way_mm, angle_rad - from_rad)
        self._go_as_counted((x_mm, y_mm, low_mm if risen else high_mm, angle_rad))

    def descend(self, x_mm: float, y_mm: float, angle_rad: float) -> None:
        """Moves straight down until the tips are at the squeeze height; the jaws must stand open."""
        self.lower(x_mm, y_mm, angle_rad, self.jaws.open_mm)

    def lower(self, x_mm: float, y_mm: float, angle_rad: float, width_mm: float) -> None:
        """Moves straight down until the tips of jaws `width_mm` apart are at the squeeze height."""
        arc = self._handling.arc
        advance_mm = 0.0 if arc is None else arc.advance_mm(width_mm)
        self._go((x_mm, y_mm, self._low_mm(advance_mm), angle_rad))

    def push(self, push: Push) -> None:
        """Comes down at the start of a push, and slides to its end; the jaws must already be set for it.

        Raises:
            GripperStateError: the jaws are no longer where they were set.
        """
        self.descend(*placement(push))
        self.slide(*end_of(push)[:2], push.speed_um_s)
        asked_um = self.calibration.nearest_um(push.opening_um)
        check_set(self.gripper.state().width_um, asked_um, self.calibration)

    def slide(self, x_mm: float, y_mm: float, speed_um_s: int | None = None) -> None:
        """Slides the hand along the table to another place, without turning it or what it holds."""
        _, _, z_mm, angle_rad = self._place()
        # An arm that was only read may stand below the squeeze height by its rounding.
        self._go((x_mm, y_mm, max(z_mm, self._low_mm(0.0)), angle_rad), speed_um_s)

    @contextmanager
    def limited(self, limits: Limits) -> Iterator[None]:
        """Context in which the hand obeys other limits, such as the limits of a delivery."""
        before, self.limits = self.limits, limits
        try:
            yield
        finally:
            self.limits = before

    def release(self, squeeze: Squeeze) -> None:
        """Releases the part: opens the jaws to the squeeze's opening, and waits until they are there."""
        self.let_go(squeeze, squeeze)
        self.jaws.wait()

    def let_go(self, squeeze: Squeeze, following: Squeeze) -> None:
        """Opens the jaws until they are clear of the part, then starts to open them for the next squeeze.

        The jaws are not opened further if the next squeeze needs a smaller opening. The tips stay level until
        they are clear of the part's sides. The jaws may still move on return; `Jaws.open` waits for them.

        Args:
            squeeze: the squeeze that ends, with whose speed and force the jaws open.
            following: the next squeeze.
        """
        self.where()  # a part that was displaced with the hand is not released
        held_mm = self.jaws.width_mm(self.jaws.ready().width_um)
        wide = max(squeeze, following, key=lambda each: each.opening_um)
        free_mm = min(held_mm + CLEAR_MM, wide.opening_um / 1000)
        arc = self._handling.arc
        if arc is not None:
            for width_mm in [*arc.stages(free_mm, held_mm)[-2::-1], free_mm]:
                self.jaws.open_to(squeeze, width_mm)
                self._level(arc.advance_mm(self.jaws.open_mm))
        elif following.opening_um / 1000 < free_mm:
            self.jaws.open_to(squeeze, free_mm)
        else:
            self.jaws.set_free(squeeze, following, free_mm)
            return
        stands_um = self.calibration.nearest_um(round(1000 * self.jaws.open_mm))
        if self.calibration.opening_um(following.opening_um) < stands_um:
            return  # narrower: the jaws are set once the hand is up
        self.jaws.set_out(squeeze._replace(opening_um=following.opening_um), fast=True)

    def close(self, node: Node) -> Settled:
        """Closes the jaws at a node (`meet`), then raises the force (`tighten`); returns the last reading.

        The errors are those of `meet`.
        """
        return self.tighten(node, self.meet(node))

    def meet(self, node: Node) -> Settled:
        """Closes the jaws by a node's squeeze until they settle; returns the reading of the last stroke.

        A regulated squeeze closes with the least force. After the last stroke the arm is checked, too.

        Raises:
            GripperStateError: the reading is not fresh, or contradicts itself.
            MotionRefusedError: the arm was displaced while the jaws closed.
        """
        open_mm = self.jaws.open_mm
        plan = strokes.closing(node, self._handling, self.calibration, open_mm, self.timing)
        for stroke, following in pairwise(plan):
            self._level(stroke.advance_mm)
            through = self.calibration.profile.streams and stroke.advance_mm == following.advance_mm
            if not (self.jaws.passes(stroke) if through else self.jaws.arrives(stroke)):
                break
        else:
            self._level(plan[-1].advance_mm)
        return self._checked(self.jaws.stroke(plan[-1]))

    def tighten(self, node: Node, reading: Settled) -> Settled:
        """Raises a regulated squeeze's force, step by step, to the node's force; returns the last reading.

        If the squeeze is not regulated or holds nothing, `reading` is returned unchanged.
        """
        forces = strokes.raising(node.squeeze, self._handling, self.calibration.profile)
        if not forces or reading.object is not ObjectState.CLOSING:
            return reading
        limit_ma, speed = self._handling.grip_current_ma, node.squeeze.speed_um_s / 1000
        for force in forces:
            if limit_ma is not None and reading.current_ma >= limit_ma:
                break
            reading = self.jaws.stroke(strokes.Stroke(CLOSED_UM, speed, force, 0.0))
            check_fresh(reading, CLOSED_UM)
            if reading.object is ObjectState.AT_TARGET:  # it slipped out: the width shows it
                break
        return self._checked(reading)

    def _checked(self, reading: Settled) -> Settled:
        check_fresh(reading, CLOSED_UM)
        self.where()
        check_closed(reading, self.calibration, self._handling.current_ma)
        return reading

    def _level(self, advance_mm: float) -> None:
        """Moves the arm up or down so that tips advanced by `advance_mm` are at the squeeze height.

        Does nothing if the tips move straight, not on an arc.
        """
        if self._handling.arc is None:
            return
        x_mm, y_mm, z_mm, angle_rad = self._place()
        height_mm = self._low_mm(advance_mm)
        if abs(height_mm - z_mm) > LEVEL_MM:
            self._go((x_mm, y_mm, height_mm, angle_rad))

    def _go(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        """Moves straight to a place; of the angles equal up to whole turns, the hand takes the nearest."""
        now_rad = self._place()[3]
        turn_rad = remainder(target[3] - now_rad, tau)
        self._go_as_counted((*target[:3], now_rad + turn_rad), speed_um_s)

    def _go_as_counted(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        """Moves straight to a place, in several motions if the hand turns by more than `MOST_TURN_RAD`.

        The speed is the limits' travel speed, unless another is given.
        """
        safety.check_target(_beside(target, self.middle_mm), self.limits)
        start = self._place()
        motions = ceil(abs(target[3] - start[3]) / MOST_TURN_RAD)
        for number in range(1, motions):
            x, y, z, angle = (
                a + (b - a) * number / motions for a, b in zip(start, target, strict=True)
            )
            self.jaws.ready()
            self._move_arm((x, y, z, angle), speed_um_s)
        self.jaws.ready()
        self._move_arm(target, speed_um_s)

    def _place(self) -> PoseOfHand:
        """The place where the fingers meet, from the arm's last target; if that is unknown, from the arm."""
        return self.where() if self._sent_to is None else _beside(self._sent_to, -self.middle_mm)

    def _move_arm(self, target: PoseOfHand, speed_um_s: int | None = None) -> None:
        self.where()
        # until it is acknowledged; an interrupt leaves it so
        self.arm_known, self._sent_to = False, None
        beside = _beside(target, self.middle_mm)
        speed_mm_s = (speed_um_s or self.limits.arm_speed_um_s) / 1000
        radius_mm = TURN_RADIUS_MM if self.jaws.holds else self.timing.turn_radius_mm
        self.arm.move_linear(beside, speed_mm_s, radius_mm)
        safety.check_placed(self.arm, beside)
        self.arm_known, self._sent_to = True, beside

    def _low_mm(self, advance_mm: float) -> float:
        return self.limits.squeeze_height_um / 1000 + max(advance_mm, 0.0)


def _outward(angle_rad: float, low_rad: float, high_rad: float) -> float:
    """How far an angle is outside the inner half of a range: 0 in the inner half, -1 and 1 at the ends."""
    half_rad = 0.5 * (high_rad - low_rad)
    if isinf(half_rad):
        return 0.0
    off = (angle_rad - low_rad) / half_rad - 1.0
    return copysign(min(max(2.0 * abs(off) - 1.0, 0.0), 1.0), off)


def _beside(place: PoseOfHand, middle_mm: float) -> PoseOfHand:
    """The place to which the arm is sent so that the fingers meet at `place`.

    The fingers meet `middle_mm` off the hand's middle. With `-middle_mm` the function is inverted: it returns
    where the fingers meet if the arm stands at `place`.
    """
    x_mm, y_mm, z_mm, angle_rad = place
    x_mm, y_mm, _ = sent((x_mm, y_mm, angle_rad), middle_mm)
    return x_mm, y_mm, z_mm, angle_rad
