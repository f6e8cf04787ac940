"""A person in place of a device: gets instructions on standard error, answers on standard input.

As an arm, `manual` asks a person to move the hand of an arm, or a gripper that no arm carries. With
`manual+ADDRESS`, a simulated arm follows the person's motions, so that the simulated gripper meets the
simulated part. As a gripper, `manual` asks a person to close calipers on the part, and to type the width.
"""

import math
import os
import select
import sys
import termios
from contextlib import suppress

from drivers import ports
from drivers.clock import Pace
from drivers.errors import ArmError, GripperFault, LinkError, PortError, ReadOnlyError
from drivers.ports import TURN_RADIUS_MM, Arm, GripperProfile, GripperState, ObjectState, PoseOfHand
from runtime.table import PROFILES

ANSWER_S = 600.0  # a person may be away
LIFT_S = 60.0  # time to lift the hand, also in a safe sequence, which must not wait for long
# Poses that are closer than this are the same: a simulated arm that follows is read so accurately.
SAME_MM, SAME_RAD = 0.1, 0.01
WHICH_WIDTH = "Close the jaws on the part: which width do you read, in mm (0 if there is nothing)?"
# Assumed pose of a hand before the first request.
ALOFT: PoseOfHand = (0.0, 0.0, 1000.0, 0.0)


class Person:
    """Asks the person at the terminal; manual arm and manual gripper share one instance."""

    def __init__(self) -> None:
        self._read = b""

    def ask(self, sentence: str, seconds: float) -> str:
        """Shows a sentence; returns the line typed after it.

        Raises:
            TimeoutError: within `seconds` the sentence could not be shown, or nothing was typed after it.
            EOFError: standard input has ended.
        """
        self._forget()
        # A held terminal (Ctrl-S) shows nothing, and printing would wait for it.
        if not select.select([], [sys.stderr.fileno()], [], seconds)[1]:
            raise TimeoutError(f"nobody read the question within {seconds:g} s")
        print(sentence, file=sys.stderr, flush=True)
        file = sys.stdin.fileno()
        while b"\n" not in self._read:
            if not select.select([file], [], [], seconds)[0]:
                raise TimeoutError(f"nobody answered within {seconds:g} s")
            piece = os.read(file, 4096)
            if not piece:
                raise EOFError("standard input ended before Enter was pressed")
            self._read += piece
        line, _, self._read = self._read.partition(b"\n")
        return line.decode(errors="replace").strip()

    def _forget(self) -> None:
        """Discards lines that were typed before the question.

        Lines from a pipe are kept: they are meant as answers.
        """
        with suppress(termios.error, ValueError):
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
            self._read = b""


PERSON = Person()


class ManualArm:
    """An arm whose motions a person carries out by hand; a simulated arm (`behind`) may repeat them.

    Without a simulated arm, the pose is the target of the last motion.
    """

    def __init__(self, behind: Arm | None, *, read_only: bool) -> None:
        self._behind, self._read_only = behind, read_only
        self._at: PoseOfHand | None = None  # last target
        self._down = False  # whether the hand was put down last
        self._unknown = ""  # why the pose is unknown; empty: it is known

    def pose(self) -> PoseOfHand:
        """The pose of the simulated arm or, without one, the last target (`ALOFT` before the first).

        Raises:
            ArmError: the last motion was not confirmed.
        """
        self._check_known()
        return (self._at or ALOFT) if self._behind is None else self._behind.pose()

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle of the simulated arm at a place, rad; infinite without a simulated arm."""
        if self._behind is None:
            return -math.inf, math.inf
        return self._behind.turn_range(x_mm, y_mm)

    def obstacle(self, start: PoseOfHand, target: PoseOfHand) -> str:
        """Returns why the simulated arm cannot make a straight motion; empty if it can or there is none."""
        return "" if self._behind is None else self._behind.obstacle(start, target)

    def move_linear(
        self, target: PoseOfHand, speed_mm_s: float, radius_mm: float = TURN_RADIUS_MM
    ) -> None:
        """Asks the person to lift the hand, to put it down, or to move it along the table.

        A motion above the table needs no person: only its target is recorded.

        Raises:
            ArmError: target or speed is invalid, the person did not answer, or standard input has ended.
            ReadOnlyError: the arm is read-only.
        """
        self._check_known()
        if self._read_only:
            raise ReadOnlyError("a dry run was about to have the hand moved")
        if not all(map(math.isfinite, (*target, speed_mm_s))) or speed_mm_s <= 0.0:
            raise ArmError(f"arm not moved: {target} at {speed_mm_s} mm/s is no motion")
        self._ask_for(target, speed_mm_s)
        if self._behind is not None:
            self._behind.move_linear(target, speed_mm_s, radius_mm)
        self._at = target

    def close(self) -> None:
        """Closes the link of the simulated arm, if any."""
        if self._behind is not None:
            self._behind.close()

    def _ask_for(self, target: PoseOfHand, speed_mm_s: float) -> None:
        x_mm, y_mm, z_mm, angle_rad = target
        where = f"({x_mm:.2f}, {y_mm:.2f}) mm, {math.degrees(angle_rad):.1f} deg"
        before = self._at or (*ALOFT[:3], math.inf)
        turn_rad = abs(before[3] - angle_rad)
        straight = math.dist(before[:2], target[:2]) < SAME_MM and turn_rad < SAME_RAD
        risen_mm = z_mm - before[2]
        if straight and risen_mm > 0.0:
            height = f"{z_mm:.0f} mm above the table"
            self._confirm(f"Lift the hand straight up, {height}; press Enter", LIFT_S)
            self._down = False
        elif straight and risen_mm < 0.0:
            height = f"the tips {z_mm:.1f} mm above the table"
            self._confirm(f"Put the hand at {where}, {height}; press Enter")
            self._down = True
        elif self._down:
            how = f"with the jaws as they are and no faster than {speed_mm_s:g} mm/s"
            self._confirm(f"Go along the table to {where}, {how}; press Enter")

    def _confirm(self, sentence: str, seconds: float = ANSWER_S) -> None:
        try:
            PERSON.ask(sentence, seconds)
        except BaseException as error:  # a stop request, too: nobody confirmed the hand's place
            self._unknown = str(error) or "the run was stopped"
            if isinstance(error, EOFError | TimeoutError):
                raise ArmError(f"arm lost, state unknown since {error}") from error
            raise

    def _check_known(self) -> None:
        if self._unknown:
            raise ArmError(f"arm lost, state unknown since {self._unknown}")


class ManualGripper:
    """Calipers, or a gripper without a link, which a person opens and closes; the person types the width."""

    def __init__(self, profile: GripperProfile, *, read_only: bool) -> None:
        self.profile = profile
        self._read_only = read_only
        self._open = _standing(ObjectState.AT_TARGET, profile.stroke_um, profile.stroke_um)
        self._seen: GripperState | None = None  # state according to the last answer
        self._asked: int | None = None  # width of a request that nobody has waited for yet, um
        self._unanswered = ""  # why the state is not known; "" if it is
        self._closed = False

    def state(self) -> GripperState:
        """Returns the state according to the person's last answer; before the first answer, open jaws.

        Raises:
            LinkError: the gripper was closed, or the person has not answered the last question.
        """
        if self._closed:
            raise LinkError("the gripper was closed")
        if self._unanswered:
            raise LinkError(self._unanswered)
        return self._seen or self._open

    def activate(self) -> None:
        """Does nothing: a gripper that a person moves needs no activation."""

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Stores the request for `wait`."""
        del speed_mm_s, force_n
        if self._read_only:
            raise ReadOnlyError("a dry run was about to have the jaws moved")
        self.state()
        self._asked = width_um

    def wait(self) -> ports.Settled:
        """Asks the person to set the requested opening, or to close the jaws and type the width.

        The person is not asked for an opening that is already set.

        Raises:
            GripperFault: no move was requested.
            LinkError: the gripper was closed, the person did not answer, or standard input has ended.
        """
        self.state()
        if self._asked is None:
            raise GripperFault("no move to wait for; call move() first")
        asked, self._asked = self._asked, None
        if asked < 0:
            width_mm = self._width_mm()
            held = width_mm >= self.profile.held_um / 1000
            state = ObjectState.CLOSING if held else ObjectState.AT_TARGET
            # Rounded to the profile's grid: a table is planned for readings of that resolution.
            width_um = self.profile.reading_um(self.profile.step(1000 * width_mm))
            self._seen = _standing(state, 0, width_um)
        elif self._seen != (opened := _standing(ObjectState.AT_TARGET, asked, asked)):
            self._ask(f"Open the jaws to {asked / 1000:.1f} mm or a little more; press Enter")
            self._seen = opened
        return ports.Settled(self._seen.width_um, self._seen.object, 0, max(asked, 0), 0.0)

    def stop(self) -> None:
        """Forgets the request, so that the person is not asked to execute it."""
        self._asked = None

    def close(self) -> None:
        """Ends the use of the gripper: its state cannot be read any more."""
        self._closed = True

    def _width_mm(self) -> float:
        """Asks for the width until a valid one is typed, mm."""
        reply = self._ask(WHICH_WIDTH)
        while True:
            with suppress(ValueError):
                width_mm = float(reply.replace(",", "."))
                if 0.0 <= width_mm <= self.profile.stroke_um / 1000:
                    return width_mm
            wanted = f"a number from 0 to {self.profile.stroke_um / 1000:g}, such as 31.42"
            reply = self._ask(f"{reply[:40]!r} is no width; type {wanted}:")

    def _ask(self, sentence: str) -> str:
        try:
            return PERSON.ask(sentence, ANSWER_S)
        except (EOFError, TimeoutError) as error:
            self._unanswered = f"the gripper's width is not known: {error}"
            raise LinkError(self._unanswered) from error


def _standing(state: ObjectState, target_um: int, width_um: int) -> GripperState:
    return GripperState(True, False, 0, "", state, target_um, width_um, 0)


def gripper(
    port: str, pace: Pace, report: ports.Report, *, read_only: bool, profile: GripperProfile | None
) -> ManualGripper:
    """Opens the manual gripper at `manual`; typed widths are rounded to the grid of a profile.

    That is the grid of `profile` or, without one, of a 2F-85.

    Raises:
        PortError: the port is not `manual`.
    """
    del pace, report
    if port != "manual":
        raise PortError(f"port {port} is not understood; write manual")
    return ManualGripper(profile or PROFILES["robotiq-2f-85"], read_only=read_only)
