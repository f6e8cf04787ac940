"""Fingers between their end stops over simulated time: strokes, contacts, and a state that lags behind."""

import math
import random
from abc import ABC, abstractmethod
from typing import NamedTuple

from drivers.ports import MOST_COUNT, GripperProfile
from drivers.robotiq.registers import OBJ_MOVING
from drivers.sim.faults import Channel, Desk, Fault, Listed
from runtime.table import PROFILES


class Surroundings:
    """What the fingers may meet, by default nothing; a subclass reacts to the motions of the fingers."""

    def closing(self) -> float | None:
        """Called when the jaws start to close; returns where they will meet something.

        Returns:
            Width at which something will stop the jaws, mm; None: nothing will.
        """
        return None

    def gripped(self) -> None:
        """Called when the jaws have stopped at the object; does nothing by default."""

    def released(self) -> None:
        """Called when the jaws open again and release the object; does nothing by default."""


class Stroke(NamedTuple):
    """A motion of the fingers at constant speed, in steps and seconds.

    `rate` is the speed with its sign; `outcome` is the object state at the end of the motion.
    """

    start: float
    start_s: float
    rate: float
    stop: float
    outcome: int

    @property
    def end_s(self) -> float:
        """Time of the end of the motion."""
        return self.start_s + (abs((self.stop - self.start) / self.rate) if self.rate else 0.0)

    def at(self, now_s: float) -> float:
        """Returns the position of the fingers at a time."""
        return self.stop if now_s >= self.end_s else self.start + self.rate * (now_s - self.start_s)


class ObjectFlag(NamedTuple):
    """The object state that a register shows during a stroke: it follows the fingers with a lag.

    The state is `old` until `moving_s`, then `OBJ_MOVING`, and `outcome` from `outcome_s` on.
    """

    old: int
    moving_s: float
    outcome: int
    outcome_s: float

    def at(self, now_s: float) -> int:
        """The state that the register shows at a time."""
        if now_s >= self.outcome_s:
            return self.outcome
        return OBJ_MOVING if now_s >= self.moving_s else self.old


class Fingers(ABC):
    """Fingers that move, and that meet, hold and release something. Times never go back.

    Positions are in the device's steps, which grow (`CLOSING` = 1) or fall (-1) as the fingers close. Each
    request that the device receives counts as one event of the fault schedule. The fingers start open.

    Args:
        rng: draws the lags.
        surroundings: what the fingers may meet; None: nothing.
        profile: profile of the model; None: the profile of `MODEL`.
        desk: gives the current faults; None: there are no faults.
    """

    MODEL: str
    CLOSING = -1.0
    CYCLE_S = 0.005  # time between two refreshes of the registers
    LAG_CYCLES = (1, 5)  # lag of a state behind its cause

    def __init__(
        self,
        rng: random.Random,
        surroundings: Surroundings | None = None,
        profile: GripperProfile | None = None,
        desk: Desk | None = None,
    ) -> None:
        self.profile = profile or PROFILES[self.MODEL]
        self._rng = rng
        self._surroundings = surroundings or Surroundings()
        self._desk = desk or Desk(Listed())
        self._faults: list[Fault] = []  # faults in effect at the last event
        self._last: int | None = None  # last position read, for a frozen reading
        self._now = self._shown_s = 0.0
        self._begin()
        start = float(self._met_at(self.profile.stroke_um / 1000.0))
        self._stroke = Stroke(start, 0.0, 0.0, start, 0)
        self._ends_s = math.inf  # end of the current stroke; infinity: none
        # Position at which the closing stroke will meet something.
        self._contact: float | None = None
        self._meets = False  # whether the current stroke ends at the contact
        self._show(OBJ_MOVING)
        self._gripping = False
        self._forget()

    @abstractmethod
    def _begin(self) -> None:
        """Initialises the attributes that a make's subclass adds, before the simulated device is powered."""

    def _met_at(self, width_mm: float) -> float:
        """The position at which an object of this width stops the fingers."""
        return width_mm

    def opening_mm(self, now_s: float) -> float:
        """True distance between the fingers, mm."""
        self.advance(now_s)
        return self._here()

    @abstractmethod
    def _arrived(self) -> None:
        """Called when a stroke has ended; a make's subclass then continues its current procedure."""

    @abstractmethod
    def _dropped(self) -> None:
        """Called when the held part has slipped out; a make's subclass then closes the fingers further."""

    @abstractmethod
    def _forget(self) -> None:
        """Resets to the state after a power failure; the fingers stay where they are."""

    def advance(self, now_s: float) -> None:
        """Advances time to `now_s`."""
        while self._ends_s <= now_s:
            self._now = max(self._now, self._ends_s)
            self._ends_s = math.inf
            if self._meets and not self._gripping:
                self._gripping = True
                self._surroundings.gripped()
            self._arrived()
        self._now = max(self._now, now_s)

    def next_change(self) -> float:
        """Time of the next change of the readings, not counting the width during a motion; infinity: none."""
        states = self._flag.moving_s, self._flag.outcome_s
        changes = (moment for moment in states if moment > self._shown_s)
        coming = min(self._ends_s, *changes, math.inf)
        return math.ceil(coming / self.CYCLE_S) * self.CYCLE_S if coming < math.inf else coming

    def power_cycle(self, now_s: float) -> None:
        """Interrupts the power for a moment: all volatile state is lost."""
        self.advance(now_s)
        self._forget()

    def lose_object(self, now_s: float) -> None:
        """Makes the held part, if any, slip out."""
        self.advance(now_s)
        if self._gripping:
            self._gripping, self._contact = False, None
            self._dropped()

    # -- faults -----------------------------------------------------------------------------------

    def next_request(self, now_s: float) -> None:
        """Counts one more request; faults that begin with the request take effect before it is executed."""
        self._desk.next(Channel.GRIPPER)
        for fault in self._desk.beginning(Channel.GRIPPER):
            if fault.kind == "power_cycle":
                self.power_cycle(now_s)
            elif fault.kind == "grip_lost":
                self.lose_object(now_s)
            elif fault.code:
                self._report(fault.code, now_s)
        self._faults = self._desk.holding(Channel.GRIPPER)

    def _report(self, code: int, now_s: float) -> None:
        """Starts the fault of this make that corresponds to a Robotiq gFLT code.

        By default there is none, and the method does nothing.
        """
        del code, now_s

    def _misread(self, position: int, most: int = MOST_COUNT) -> int:
        """Returns the position that the device reports for a true one under the current faults.

        Positions are from 0 to `most`; the values of the faults are in 255ths of `most`.
        """
        values = {fault.kind: round(fault.value * most / MOST_COUNT) for fault in self._faults}
        if "count_frozen" not in values or self._last is None:
            self._last = position
        position = self._last + values.get("encoder_offset", 0)
        return min(max(values.get("count_spike", position), 0), most)

    def _misstated(self, *, moving: bool) -> int | None:
        """Returns the gOBJ that a current fault reports instead of the true one; None if there is none."""
        for fault in self._faults:
            if fault.kind == "flag_stuck" or (fault.kind == "flag_false" and moving):
                return int(fault.value) & 3
        return None

    # -- motion -----------------------------------------------------------------------------------

    def _refresh(self, now_s: float) -> None:
        """Advances time to the last refresh of the registers before `now_s`."""
        self.advance(max(math.floor(now_s / self.CYCLE_S) * self.CYCLE_S, self._now))
        self._shown_s = self._now

    def _show(self, state: int) -> None:
        """Sets the object state that the gripper reports from now on, without a lag."""
        self._flag = ObjectFlag(state, self._now, state, self._now)

    def _follow(self) -> None:
        """Schedules the object state that the gripper reports: moving, then the outcome of the stroke.

        Each state appears after a random lag.
        """
        moving_s, outcome_s = self._now + self._lag(), self._stroke.end_s + self._lag()
        shown = self._flag.at(self._now)
        self._flag = ObjectFlag(shown, moving_s, self._stroke.outcome, outcome_s)

    def _here(self) -> float:
        return self._stroke.at(self._now)

    def _lag(self) -> float:
        late_s = sum(fault.value for fault in self._faults if fault.kind == "flag_late")
        return self._rng.randint(*self.LAG_CYCLES) * self.CYCLE_S + late_s

    def _start(
        self, target: float, speed: float, outcomes: tuple[int, int] = (0, 0), *, meets: bool = True
    ) -> None:
        """Sets the fingers in motion; a closing stroke asks the surroundings once what it will meet.

        Args:
            target: end of the stroke if it meets nothing.
            speed: steps per second.
            outcomes: object state at the end if the stroke meets nothing, and if it meets something.
            meets: whether the stroke may meet anything.
        """
        here, (outcome, met) = self._here(), outcomes
        way = (target - here) * self.CLOSING
        closing = self._ends_s < math.inf and self._stroke.rate * self.CLOSING > 0.0
        if way > 0.0 and meets and not (closing or self._gripping):
            width_mm = self._surroundings.closing()
            self._contact = None if width_mm is None else self._met_at(width_mm)
        elif way <= 0.0:  # 0: fully open jaws that hold something release it without moving
            self._contact = None
            if self._gripping:
                self._gripping = False
                self._surroundings.released()
        self._meets = False
        if way > 0.0 and self._contact is not None:
            free = (self._contact - here) * self.CLOSING
            self._meets = free <= way
            if self._meets:
                target, outcome = self._contact if free > 0.0 else here, met
        rate = math.copysign(speed, target - here) if target != here else 0.0
        self._stroke = Stroke(here, self._now, rate, target, outcome)
        self._ends_s = self._stroke.end_s

    def _halt(self, outcome: int = 0) -> None:
        """Stops the fingers where they are, and cancels a grip that is not complete."""
        here = self._here()
        self._stroke = Stroke(here, self._now, 0.0, here, outcome)
        if self._ends_s < math.inf:
            self._ends_s, self._contact = math.inf, None
