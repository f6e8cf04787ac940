"""A gripper of DH-Robotics' AG or PGC series as a state machine over simulated time; no I/O, no clock.

The registers are those of `drivers.dh.registers`. What the manuals leave open, the device does so that a
driver must not rely on it: the grip state follows a command late, and a value out of range meets silence.
"""

import math
import random
import struct
from collections.abc import Callable

from drivers.dh import registers as dh
from drivers.dh.percent import Scale
from drivers.dh.registers import Grip, Initialised
from drivers.ports import GripperProfile
from drivers.sim.devices.jaws import ObjectFlag, Stroke, Surroundings
from drivers.sim.faults import Channel, Desk

CYCLE_S = 0.005  # between two refreshes of the states
LAG_CYCLES = (1, 5)  # of the grip state behind the command
SEARCH_PERCENT = 40  # speed of the initialisation

ALLOWED = {
    dh.INITIALISATION: (dh.INITIALISE, dh.CALIBRATE),
    dh.FORCE: range(dh.LEAST_FORCE, dh.MOST + 1),
    dh.POSITION: range(dh.FULL + 1),
    dh.SPEED: range(dh.LEAST_SPEED, dh.MOST + 1),
    dh.SAVE: (0, 1),
    dh.DIRECTION: (0, 1),
    dh.DIRECTION + 1: range(256),  # slave address
    dh.DIRECTION + 2: range(6),  # baud rate
    dh.DIRECTION + 3: (0, 1),  # stop bits
    dh.DIRECTION + 4: range(3),  # parity
}
READABLE = {
    register
    for first, count in (dh.CONTROL, dh.STATUS, dh.SETTINGS)
    for register in range(first, first + count)
}
FUNCTIONS = {3, 6, 16}
DEFAULTS = {dh.FORCE: 100, dh.SPEED: 100, dh.DIRECTION + 1: dh.UNIT}  # the rest is 0


class DhModel:
    """A DH gripper from power-up on. Times are simulated seconds and never go back.

    Args:
        rng: draws the lags of the grip state.
        surroundings: what the fingers may meet.
        profile: of its model.
    """

    def __init__(
        self, rng: random.Random, surroundings: Surroundings, profile: GripperProfile
    ) -> None:
        self._scale = Scale(profile)
        self._open_mm = profile.stroke_um / 1000.0
        self.writes = 0  # how often a register was written
        self.state_delay_s = 0.0  # how much later than usual the grip state follows
        self._rng = rng
        self._surroundings = surroundings
        self._now = self._shown_s = 0.0
        self._closed_mm = 0.0  # opening that was learnt as position 0
        self._settings = dict.fromkeys(ALLOWED, 0) | DEFAULTS
        self._stroke = Stroke(self._open_mm, 0.0, 0.0, self._open_mm, Grip.AT_POSITION)
        self._running = self._gripping = False
        self._contact: float | None = (
            None  # opening at which the closing stroke will meet something
        )
        self._forget()

    def _forget(self) -> None:
        """What the supply's failure leaves: the fingers stay where they are, uninitialised."""
        here = self._stroke.at(self._now)
        self._stroke = Stroke(here, self._now, 0.0, here, Grip.AT_POSITION)
        if self._running:  # a grip that was not completed has not happened
            self._running, self._contact = False, None
        self._flag = _shown(Grip.AT_POSITION, self._now)
        self._initialised = Initialised.NO
        self._searches: list[float] = []  # openings that the initialisation still has to visit
        self._settings[dh.POSITION] = 0

    # -- the registers ----------------------------------------------------------------------------

    def heard(self, now_s: float) -> None:
        """A request arrived, and is served next."""

    def read(self, address: int, now_s: float) -> int:
        """One of the `READABLE` registers."""
        self.advance(max(math.floor(now_s / CYCLE_S) * CYCLE_S, self._now))
        self._shown_s = self._now
        match address:
            case dh.INITIALISATION:
                return int(self._initialised is Initialised.IN_PROGRESS)
            case dh.INITIALISED:
                return self._initialised
            case dh.GRIP:
                return self._flag.at(self._now)
            case dh.ACTUAL_POSITION:
                return self._position()
        return self._settings.get(address, 0)

    def write(self, address: int, value: int, now_s: float) -> None:
        """Write a value that is `ALLOWED` to a register, and obey."""
        self.advance(now_s)
        self.writes += 1
        self._settings[address] = value
        if address == dh.INITIALISATION:
            self._initialise(value)
        elif address == dh.POSITION and self._initialised is Initialised.YES:
            self._go()

    def _position(self) -> int:
        learnt_mm = self._open_mm - self._closed_mm
        share = (self._stroke.at(self._now) - self._closed_mm) / learnt_mm
        return min(max(round(dh.FULL * share), 0), dh.FULL)

    def opening_mm(self, now_s: float) -> float:
        """True distance between the fingers."""
        self.advance(now_s)
        return self._stroke.at(self._now)

    def advance(self, now_s: float) -> None:
        """Let time pass up to `now_s`."""
        while self._running and self._stroke.end_s <= now_s:
            self._now = max(self._now, self._stroke.end_s)
            self._arrive()
        self._now = max(self._now, now_s)

    def next_change(self) -> float:
        """When the next reading will differ from the last, but for a moving position; infinity: never."""
        flag = (self._flag.moving_s, self._flag.outcome_s)
        changes = [moment for moment in flag if moment > self._shown_s]
        coming = min([*changes, self._stroke.end_s if self._running else math.inf])
        return math.ceil(coming / CYCLE_S) * CYCLE_S if coming < math.inf else coming

    # -- mishaps ----------------------------------------------------------------------------------

    def power_cycle(self, now_s: float) -> None:
        """The supply failed for a moment."""
        self.advance(now_s)
        self._forget()

    def lose_object(self, now_s: float) -> None:
        """What the fingers hold slips out: they close on, to the position asked for."""
        self.advance(now_s)
        if not self._gripping:
            return
        self._gripping, self._contact = False, None
        if self._initialised is Initialised.YES:
            self._go(dropped=True)

    # -- motion -----------------------------------------------------------------------------------

    def _initialise(self, how: int) -> None:
        """Look for one end stop, or for both."""
        self._initialised = Initialised.IN_PROGRESS
        self._flag = _shown(Grip.MOVING, self._now)
        ends = [self._open_mm, 0.0]
        if self._settings[dh.DIRECTION]:
            ends.reverse()
        self._searches = ends[:1] if how == dh.INITIALISE else ends[::-1]
        self._start(self._searches.pop(0), SEARCH_PERCENT)

    def _go(self, *, dropped: bool = False) -> None:
        shown = self._flag.at(self._now)
        learnt_mm = self._open_mm - self._closed_mm
        target = self._closed_mm + learnt_mm * self._settings[dh.POSITION] / dh.FULL
        self._start(target, self._settings[dh.SPEED], dropped=dropped)
        moving_s, outcome_s = self._now + self._lag(), self._stroke.end_s + self._lag()
        self._flag = ObjectFlag(shown, moving_s, self._stroke.outcome, outcome_s)

    def _lag(self) -> float:
        return self._rng.randint(*LAG_CYCLES) * CYCLE_S + self.state_delay_s

    def _start(self, target: float, percent: int, *, dropped: bool = False) -> None:
        """Set the fingers in motion; a closing stroke asks once what it meets."""
        here = self._stroke.at(self._now)
        closing = self._running and self._stroke.rate < 0.0
        if target < here and not (closing or self._gripping or dropped):
            self._contact = self._surroundings.closing()
        elif target > here:
            self._contact = None
            if self._gripping:
                self._gripping = False
                self._surroundings.released()
        stop, outcome = target, Grip.DROPPED if dropped else Grip.AT_POSITION
        if target < here and self._contact is not None and self._contact >= target:
            stop, outcome = min(self._contact, here), Grip.CAUGHT
        rate = math.copysign(self._scale.speed_mm_s(percent), stop - here) if stop != here else 0.0
        self._stroke = Stroke(here, self._now, rate, stop, outcome)
        self._running = True

    def _arrive(self) -> None:
        """The stroke is over: grip, or search on."""
        self._running = False
        if self._stroke.outcome == Grip.CAUGHT and not self._gripping:
            self._gripping = True
            self._surroundings.gripped()
        if self._initialised is not Initialised.IN_PROGRESS:
            return
        if self._stroke.rate < 0.0:
            # Whatever stopped the fingers is taken for the end stop.
            self._closed_mm = self._stroke.stop
        if self._searches:
            self._start(self._searches.pop(0), SEARCH_PERCENT)
            return
        self._initialised = Initialised.YES
        self._flag = _shown(Grip.AT_POSITION, self._now)
        self._settings[dh.POSITION] = self._position()


def _shown(grip: Grip, now_s: float) -> ObjectFlag:
    """A grip state that shows at once and stays."""
    return ObjectFlag(grip, now_s, grip, now_s)


class FaultyDhModel(DhModel):
    """A DH gripper that fails as a schedule has it; it has no fault register, so no gFLT befalls it.

    Args:
        rng: as of `DhModel`.
        surroundings: what the fingers may meet.
        profile: of its model.
        desk: says what holds when; each request that the gripper hears is one event.
    """

    def __init__(
        self, rng: random.Random, surroundings: Surroundings, profile: GripperProfile, desk: Desk
    ) -> None:
        super().__init__(rng, surroundings, profile)
        self._desk = desk
        self._last = dh.FULL  # the position as it was last read, which is what freezes

    def heard(self, now_s: float) -> None:
        """One more event: whatever befalls the gripper now, befalls it before it obeys."""
        self._desk.next(Channel.GRIPPER)
        kinds = {fault.kind for fault in self._desk.beginning(Channel.GRIPPER)}
        if "power_cycle" in kinds:
            self.power_cycle(now_s)
        if "grip_lost" in kinds:
            self.lose_object(now_s)
        late = self._desk.holds("flag_late")
        self.state_delay_s = late.value if late else 0.0

    def read(self, address: int, now_s: float) -> int:
        """One register, with whatever is wrong with it."""
        word = super().read(address, now_s)
        if address == dh.GRIP:
            false = self._desk.holds("flag_false") if word == Grip.MOVING else None
            if fault := self._desk.holds("flag_stuck") or false:
                return int(fault.value)
        elif address == dh.ACTUAL_POSITION:
            if not self._desk.holds("count_frozen"):
                self._last = word
            offset, spike = self._desk.holds("encoder_offset"), self._desk.holds("count_spike")
            word = self._last + (_thousandths(offset.value) if offset else 0)
            word = min(max(_thousandths(spike.value) if spike else word, 0), dh.FULL)
        return word


def _thousandths(counts: float) -> int:
    """Of the stroke, where a schedule says 255ths."""
    return round(counts * dh.FULL / 255)


class DhRegisters:
    """A DH gripper's registers as `drivers.sim.wire.modbus.answer` asks for them.

    Args:
        device: the gripper.
        now: simulated seconds.
    """

    def __init__(self, device: DhModel, now: Callable[[], float]) -> None:
        self._device = device
        self._now = now

    def serves(self, function: int, address: int, count: int) -> bool:
        """Whether `function` is spoken here and there are so many registers."""
        return function in FUNCTIONS and READABLE.issuperset(range(address, address + count))

    def read(self, address: int, count: int) -> bytes:
        """So many registers."""
        now_s = self._now()
        self._device.heard(now_s)
        words = [self._device.read(address + step, now_s) for step in range(count)]
        return struct.pack(f">{count}H", *words)

    def write(self, function: int, address: int, data: bytes) -> bool:
        """Write registers in their order, or none of them where one is refused."""
        words = dict(enumerate(struct.unpack(f">{len(data) // 2}H", data), address))
        taken = function in FUNCTIONS and all(
            word in ALLOWED.get(register, ()) for register, word in words.items()
        )
        if taken:
            self._device.heard(now_s := self._now())
            for register, word in words.items():
                self._device.write(register, word, now_s)
        return taken
