"""The deadline of one squeeze, checked while its devices are waited for, and which of them exceeded it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from math import inf
from typing import Any, NamedTuple, TypeVar, cast

from runtime.devices.clock import SystemClock
from runtime.errors import CellError, GripperStateError, MotionRefusedError
from runtime.shell import interrupts

# How much longer than stroke and path take at the commanded speeds one squeeze may last.
DEADLINE_FACTOR = 3.0
ARM, GRIPPER, MACHINE = "arm", "gripper", "this machine"
REMEDIES = {
    ARM: "check its speed, and what slows it down",
    GRIPPER: "check its speed, and what slows it down",
    MACHINE: "take load off it, and check its disk",
}
Device = TypeVar("Device")


class Expected(NamedTuple):
    """Cell seconds that a squeeze takes at the commanded speeds, by the device that is waited for."""

    arm_s: float
    gripper_s: float

    @property
    def total_s(self) -> float:
        """Both, one after the other."""
        return self.arm_s + self.gripper_s


class Watch:
    """Counts the seconds that each device is waited for; within `squeeze` each call has to begin in time.

    Where stop requests are listened to, a call that is under way at the deadline is ended as by one.
    """

    def __init__(self, clock: SystemClock) -> None:
        self._clock = clock
        self._expected = Expected(0.0, 0.0)
        self._began = 0.0
        self._deadline = inf
        self._spent = {ARM: 0.0, GRIPPER: 0.0}
        self._waiting: tuple[str, float] | None = None  # for which device, since when

    def watched(self, device: Device, name: str) -> Device:
        """The same device, each of whose calls counts."""
        return cast(Device, _Watched(device, name, self))

    @contextmanager
    def squeeze(self, expected: Expected, patience: float = 1.0) -> Iterator[None]:
        """A squeeze, which may last `DEADLINE_FACTOR` times as long as expected, and `patience` times that.

        Raises:
            MotionRefusedError: it lasts longer because of the arm. GripperStateError: of anything else.
        """
        self._expected, self._began = expected, self._clock.now()
        self._spent = dict.fromkeys(self._spent, 0.0)
        self._deadline = self._clock.deadline(DEADLINE_FACTOR * patience * expected.total_s)
        try:
            with interrupts.within(self._deadline - self._began, self._late):
                yield
                self.check()
        finally:
            self._deadline = inf

    def check(self) -> None:
        """Raise if the squeeze is late."""
        if self._clock.now() > self._deadline:
            raise self._late()

    def call(self, name: str, method: Callable[..., Any], *arguments: Any) -> Any:
        """Call a device in time, and count how long it takes."""
        self.check()
        began = self._clock.now()
        self._waiting = (name, began)
        try:
            return method(*arguments)
        finally:
            self._waiting = None
            self._spent[name] += self._clock.now() - began

    def _late(self) -> CellError:
        now, spent = self._clock.now(), dict(self._spent)
        if self._waiting is not None:
            name, since = self._waiting
            spent[name] += now - since
        spent[MACHINE] = now - self._began - sum(spent.values())
        expected = {ARM: self._expected.arm_s, GRIPPER: self._expected.gripper_s, MACHINE: 0.0}
        slowest = max(spent, key=lambda name: spent[name] - expected[name])
        most_s = self._deadline - self._began
        told = (
            f"the squeeze may take {most_s:.1f} s and is {max(now - self._deadline, 0.0):.1f} s late: "
            f"{_the(slowest)} took {spent[slowest]:.1f} s, {expected[slowest]:.1f} s are usual; "
            f"{REMEDIES[slowest]}"
        )
        return MotionRefusedError(told) if slowest == ARM else GripperStateError(told)


def _the(name: str) -> str:
    return name if name == MACHINE else f"the {name}"


class _Watched:
    """A device whose calls a watch counts."""

    def __init__(self, device: object, name: str, watch: Watch) -> None:
        self._device, self._name, self._watch = device, name, watch

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(self._device, attribute)
        if not callable(value):
            return value

        @wraps(value)
        def counted(*arguments: Any) -> Any:
            return self._watch.call(self._name, value, *arguments)

        return counted
