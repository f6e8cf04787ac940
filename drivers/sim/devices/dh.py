"""A gripper of DH-Robotics' AG or PGC series as a state machine over simulated time; no I/O, no clock.

`drivers.dh.registers` lists the registers. Where the manuals are unclear, the device behaves adversely, so
that a driver that relies on an assumption fails: the grip state follows a command late, and a value out of
range gets no answer.
"""

import struct
from collections.abc import Callable

from drivers.dh import registers as dh
from drivers.dh.percent import MODEL, Scale
from drivers.dh.registers import Grip, Initialised
from drivers.sim.devices.jaws import Fingers

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
BLOCKS = (dh.CONTROL, dh.STATUS, dh.SETTINGS)
READABLE = {first + step for first, count in BLOCKS for step in range(count)}
DEFAULTS = {dh.FORCE: 100, dh.SPEED: 100, dh.DIRECTION + 1: dh.UNIT}  # the rest is 0


class DhModel(Fingers):
    """A DH gripper from power-up on. Times are simulated seconds and never go back.

    The gripper has no fault register, so the faults that set a Robotiq gripper's gFLT do not apply.
    """

    MODEL = MODEL

    def _begin(self) -> None:
        self._open_mm = self.profile.stroke_um / 1000.0
        self._scale = Scale(self.profile)
        self.writes = 0  # number of registers written so far
        self._closed_mm = 0.0  # opening learnt as position 0
        self._settings = dict.fromkeys(ALLOWED, 0) | DEFAULTS

    def _forget(self) -> None:
        """Resets to the state after a power failure: not initialised."""
        self._halt(Grip.AT_POSITION)
        self._show(Grip.AT_POSITION)
        self._initialised = Initialised.NO
        self._searches: list[float] = []  # openings that the initialisation still has to visit
        self._settings[dh.POSITION] = 0

    # -- the registers ----------------------------------------------------------------------------

    def read(self, address: int, now_s: float) -> int:
        """Reads one of the `READABLE` registers."""
        self._refresh(now_s)
        match address:
            case dh.INITIALISATION:
                return int(self._initialised is Initialised.IN_PROGRESS)
            case dh.INITIALISED:
                return self._initialised
            case dh.GRIP:
                grip = self._flag.at(self._now)
                misstated = self._misstated(moving=grip == Grip.MOVING)
                return grip if misstated is None else misstated
            case dh.ACTUAL_POSITION:
                return self._misread(self._position(), dh.FULL)
        return self._settings.get(address, 0)

    def write(self, address: int, value: int, now_s: float) -> None:
        """Writes to a register, and executes the command in it, if any; the caller checks `ALLOWED`."""
        self.advance(now_s)
        self.writes += 1
        self._settings[address] = value
        if address == dh.INITIALISATION:
            self._initialise(value)
        elif address == dh.POSITION and self._initialised is Initialised.YES:
            self._go()

    def _position(self) -> int:
        learnt_mm = self._open_mm - self._closed_mm
        share = (self._here() - self._closed_mm) / learnt_mm
        return min(max(round(dh.FULL * share), 0), dh.FULL)

    # -- mishaps ----------------------------------------------------------------------------------

    def _dropped(self) -> None:
        """Called when the held part is lost: the fingers go on closing to the requested position."""
        if self._initialised is Initialised.YES:
            self._go(dropped=True)

    # -- motion -----------------------------------------------------------------------------------

    def _initialise(self, how: int) -> None:
        """Starts the initialisation: the fingers search for one end stop or, to learn the stroke, for both.

        `how` is the value written to the register: `INITIALISE` for one end stop, any other for both.
        """
        self._initialised = Initialised.IN_PROGRESS
        self._show(Grip.MOVING)
        ends = [self._open_mm, 0.0]
        if self._settings[dh.DIRECTION]:
            ends.reverse()
        self._searches = ends[:1] if how == dh.INITIALISE else ends[::-1]
        self._drive(self._searches.pop(0), SEARCH_PERCENT)

    def _go(self, *, dropped: bool = False) -> None:
        learnt_mm = self._open_mm - self._closed_mm
        target = self._closed_mm + learnt_mm * self._settings[dh.POSITION] / dh.FULL
        self._drive(target, self._settings[dh.SPEED], dropped=dropped)
        self._follow()

    def _drive(self, target: float, percent: int, *, dropped: bool = False) -> None:
        free = Grip.DROPPED if dropped else Grip.AT_POSITION
        speed = self._scale.speed_mm_s(percent)
        self._start(target, speed, (free, Grip.CAUGHT), meets=not dropped)

    def _arrived(self) -> None:
        """Called when a stroke has ended: continues or finishes the initialisation, if it is in progress."""
        if self._initialised is not Initialised.IN_PROGRESS:
            return
        if self._stroke.rate < 0.0:
            # Anything that stops the fingers is taken for the end stop.
            self._closed_mm = self._stroke.stop
        if self._searches:
            self._drive(self._searches.pop(0), SEARCH_PERCENT)
            return
        self._initialised = Initialised.YES
        self._show(Grip.AT_POSITION)
        self._settings[dh.POSITION] = self._position()


class DhRegisters:
    """A DH gripper's registers for `drivers.sim.wire.modbus.answer`.

    Args:
        device: the gripper.
        now: simulated seconds.
    """

    functions = frozenset({3, 6, 16})

    def __init__(self, device: DhModel, now: Callable[[], float]) -> None:
        self._device = device
        self._now = now

    def serves(self, address: int, count: int) -> bool:
        """Whether the gripper has these registers."""
        return READABLE.issuperset(range(address, address + count))

    def read(self, address: int, count: int) -> bytes:
        """Reads `count` registers."""
        now_s = self._now()
        self._device.next_request(now_s)
        words = [self._device.read(address + step, now_s) for step in range(count)]
        return struct.pack(f">{count}H", *words)

    def write(self, address: int, data: bytes) -> bool:
        """Writes registers in order; writes none and returns False if one of them is refused."""
        words = dict(enumerate(struct.unpack(f">{len(data) // 2}H", data), address))
        taken = all(word in ALLOWED.get(register, ()) for register, word in words.items())
        if taken:
            self._device.next_request(now_s := self._now())
            for register, word in words.items():
                self._device.write(register, word, now_s)
        return taken
