"""Device logic of a DH gripper: initialisation, moves, and detection of stale states.

The gripper has no register for a stop, a fault or the motor current. `drivers.dh.registers` lists the
sources.
"""

from collections.abc import Callable
from typing import NamedTuple

from drivers.clock import Pace
from drivers.dh import registers as dh
from drivers.dh.link import RtuLink
from drivers.dh.percent import Scale
from drivers.dh.registers import Grip, Initialised
from drivers.errors import GripperFault
from drivers.modbus import address
from drivers.polling import Move, PolledGripper
from drivers.ports import GripperProfile, GripperState, ObjectState, Report

INITIALISE_S = 10.0  # time limit: a stroke at a speed that no manual states
REST_S = 1.0  # time within which stopped fingers come to rest
ARRIVED = 10  # positions: distance from the request above which "at position" is contradictory
REPEATING = "repeating a write whose answer was lost"


class Reading(NamedTuple):
    """One reading of the gripper: states, positions in thousandths of the stroke, and control registers."""

    initialised: Initialised
    grip: Grip
    position: int
    target: int  # requested position
    settings: dict[int, int]  # content of the control registers

    @property
    def ready(self) -> bool:
        """Whether the gripper may be moved."""
        return self.initialised is Initialised.YES

    @property
    def moving(self) -> bool:
        """Whether the fingers are moving."""
        if self.ready:
            return self.grip is Grip.MOVING
        return self.initialised is Initialised.IN_PROGRESS

    @property
    def object(self) -> ObjectState:
        """Whether and how an object stopped the fingers; the target tells if they were closing or opening."""
        if not self.ready or self.moving:
            return ObjectState.NONE
        if self.grip is not Grip.CAUGHT:
            return ObjectState.AT_TARGET
        return ObjectState.CLOSING if self.target < self.position else ObjectState.OPENING


class Gripper(PolledGripper[Reading, int]):
    """Driver of a DH gripper; connecting only reads.

    The target of a move is a position, in thousandths of the stroke.
    """

    stale_s = 0.2  # time during which the grip state may still belong to the previous move

    _link: RtuLink

    def _begin(self, profile: GripperProfile | None) -> GripperProfile:
        self._scale = Scale(profile)
        self._read()
        return self._scale.profile

    def activate(self) -> None:
        """Initialises a gripper that is not yet initialised; otherwise sends nothing.

        The fingers open, or close if the gripper is so configured; a held part is dropped.

        This does not calibrate the stroke. A calibration closes the fingers on anything between them; it is
        done with the maker's software, once after a change of fingers.
        """
        seen = self._read()
        if seen.ready:
            return
        deadline = self._pace.deadline(INITIALISE_S)
        if seen.initialised is Initialised.NO:
            self._write(dh.INITIALISATION, dh.INITIALISE, self._initialises)
        self._until(lambda now: now.ready, deadline, "initialising")

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Requests a width, at a speed and with a force; `wait` returns the result."""
        self._move = None
        seen = self._checked("asked to move")
        target, speed = self._scale.position(width_um), self._scale.speed(speed_mm_s)
        for register, value in ((dh.FORCE, self._scale.force(force_n)), (dh.SPEED, speed)):
            if seen.settings[register] != value:
                self._set(register, value)
        speed_mm_s = self._scale.speed_mm_s(speed)
        budget_s = self._budget_s(speed_mm_s)
        step_s = self.profile.resolution_um / 1000.0 / speed_mm_s
        self._ask(target)
        self._move = Move(target, seen, self._pace.now(), budget_s, step_s)

    def stop(self) -> None:
        """Stops the fingers by requesting their current position; a held part stays held.

        Raises:
            GripperFault: the gripper is initialising, which cannot be stopped, or the fingers do not come to
                rest.
        """
        self._move = None
        seen = self._past_stale(self._read())
        if seen.initialised is Initialised.IN_PROGRESS:
            raise GripperFault(
                "the gripper cannot be stopped while it initialises; cut its supply if it must be"
            )
        # Fingers that hold something stand still, and press since they are not at their request.
        if not seen.ready or seen.grip is Grip.CAUGHT:
            return
        self._ask(seen.position)
        deadline = self._pace.deadline(REST_S)
        self._past_stale(self._read())
        self._until(lambda now: not now.moving, deadline, "stopping")

    def _read(self) -> Reading:
        words = self._link.read()
        try:
            states = Initialised(words[dh.INITIALISED]), Grip(words[dh.GRIP])
            return Reading(*states, words[dh.ACTUAL_POSITION], words[dh.POSITION], dict(words))
        except ValueError as error:
            raise GripperFault(
                f"gripper at {self._link.endpoint} is in no state that a DH gripper has ({error}); "
                "check that it is one"
            ) from error

    def _target(self, seen: Reading) -> int:
        return seen.target

    def _state(self, seen: Reading, target: int) -> GripperState:
        return GripperState(
            activated=seen.ready,
            moving=seen.moving,
            fault=0,
            fault_text="",
            object=seen.object,
            target_um=self.profile.reading_um(target),
            width_um=self.profile.reading_um(seen.position),
            current_ma=0,
        )

    def _rest(self, seen: Reading, move: Move[Reading, int]) -> int | None:
        return seen.position if self._fits(seen, move) else None

    def _fits(self, seen: Reading, move: Move[Reading, int]) -> bool:
        """Whether the grip state is final and agrees with the position; a stale state usually disagrees."""
        if seen.moving:
            return False
        if seen.grip is not Grip.CAUGHT:
            return abs(seen.position - move.target) <= ARRIVED
        # A part stops the fingers short of the request; at the request, the state is of the previous move.
        return seen.position != move.target or move.before.position == move.target

    def _require_ready(self, seen: Reading, doing: str) -> None:
        if not seen.ready:
            raise GripperFault(
                f"gripper not active while {doing}, it is not initialised; clear the fingers and activate it "
                "(--activate)"
            )

    def _sketch(self, seen: Reading) -> str:
        states = f"{seen.initialised.name}, {seen.grip.name}"
        return f"{states}, position {seen.position}, request {seen.target}"

    def _initialises(self) -> bool:
        return self._read().initialised is not Initialised.NO

    def _ask(self, target: int) -> None:
        self._asked_at = self._pace.now()
        self._set(dh.POSITION, target)

    def _set(self, register: int, value: int) -> None:
        self._write(register, value, lambda: self._checked(REPEATING).settings[register] == value)

    def _write(self, register: int, value: int, arrived: Callable[[], bool]) -> None:
        """Writes a register, at most `WRITE_TRIES` times, until a write is acknowledged.

        Repeating is harmless: the same position again starts no motion.
        """
        self._repeat(lambda: self._link.write(register, value), arrived)


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """Opens a DH gripper at `dh:///dev/ttyUSB0`, or at `dh://host:port` behind a serial device server.

    `?unit=2` at the end of the port's name states the slave id.

    Raises:
        PortError: the port cannot be opened or is not understood, or the profile is of another make.
        LinkError: there is no answer.
    """
    unit = address.unit_of(port, dh.UNIT)
    Scale(profile)  # before anything is opened
    link = RtuLink(address.opened(port, dh.BAUD), pace, report, unit)
    return Gripper(link, pace, report, profile, read_only=read_only)
