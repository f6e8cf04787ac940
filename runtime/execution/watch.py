"""Checks the deadline of a squeeze at each device call, and names the device that exceeded it."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import hypot, inf, tau
from typing import Any, NamedTuple, TypeVar, cast

from runtime.devices.clock import Lap, SystemClock
from runtime.errors import GripperStateError, MotionRefusedError
from runtime.shell import interrupts
from runtime.shell.errors import DeviceError
from runtime.table import Node, Schedule, Table, job_of

# Allowed time of a squeeze, as a multiple of `Expected.total_s`.
DEADLINE_FACTOR = 3.0
ARM, GRIPPER, MACHINE = "arm", "gripper", "this machine"
SLOW = "check its speed, and what slows it down"
REMEDIES = {ARM: SLOW, GRIPPER: SLOW, MACHINE: "take load off it, and check its disk"}
Device = TypeVar("Device")


class Expected(NamedTuple):
    """How long arm and gripper should take for a squeeze at the commanded speeds, in seconds of the cell."""

    arm_s: float
    gripper_s: float

    @property
    def total_s(self) -> float:
        """Sum of the times of arm and gripper."""
        return self.arm_s + self.gripper_s


def expected_of(table: Table, node: Node, slowest_um_s: int | None = None) -> Expected:
    """How long the longest possible squeeze at a node takes, with its pushes, in seconds of the cell.

    In such a squeeze the arm moves across the work area, turns once, and makes three vertical moves; the jaws
    make three full strokes. Each push adds all this once more, and the time of its path.

    Args:
        table: states the work area, the gripper and the arm's timing.
        node: the node to squeeze at.
        slowest_um_s: the jaws are assumed to move at this speed, or at the squeeze's speed if that is lower.
            None: the least speed of the gripper.
    """
    timing = Schedule.of(table, job_of(table)).timing
    slowest_um_s = slowest_um_s or table.gripper.least_speed_um_s
    area = table.limits.work_area_um
    across_mm = hypot(area.x_max - area.x_min, area.y_max - area.y_min) / 1e3
    arm_s = timing.move_s(across_mm) + timing.move_s(0.0, tau)
    arm_s += 3 * timing.move_s(timing.retreat_mm - timing.squeeze_mm)
    speed_mm_s = min(node.squeeze.speed_um_s, slowest_um_s) / 1e3
    ways_s = sum(
        timing.move_s(push.length_um / 1e3, 0.0, push.speed_um_s / 1e3) for push in node.pushes
    )
    times = 1 + len(node.pushes)
    strokes_s = 3 * timing.close_s(table.gripper.opening_um / 1e3, None, 0.0, speed_mm_s)
    return Expected(times * arm_s + ways_s, times * strokes_s)


class Watch:
    """Sums up the seconds that each device takes, and raises when a squeeze exceeds its deadline.

    The time from one call to the next counts for the device of the earlier call. In the context `squeeze`, a
    call after the deadline raises; within `StopRequests` the deadline also interrupts a call in progress.
    """

    def __init__(self, clock: SystemClock) -> None:
        self._clock = clock
        self._expected = Expected(0.0, 0.0)
        self._lap, self._deadline = Lap(clock), inf
        self._spent = dict.fromkeys(REMEDIES, 0.0)
        self._called = MACHINE

    def watched(self, device: Device, name: str) -> Device:
        """Wraps a device so that the watch registers each of its calls under `name`.

        A call under the name `MACHINE`, which is used for the journal, does not raise after the deadline.
        """
        return cast(Device, _Watched(device, name, self))

    @contextmanager
    def squeeze(self, expected: Expected, patience: float = 1.0) -> Iterator[None]:
        """Context of a squeeze, which may last `patience` x `DEADLINE_FACTOR` times its expected duration.

        The clock adds `LINK_MARGIN_S` to this time.

        Raises:
            MotionRefusedError: the squeeze lasts longer because of the arm.
            GripperStateError: the squeeze lasts longer because of anything else.
        """
        self._expected, self._spent = expected, dict.fromkeys(REMEDIES, 0.0)
        self._lap, self._called = Lap(self._clock), MACHINE
        self._deadline = self._clock.deadline(DEADLINE_FACTOR * patience * expected.total_s)
        try:
            with interrupts.within(self._deadline - self._clock.now(), self._late):
                yield
                self._check()
        finally:
            self._deadline = inf

    def call(self, name: str) -> None:
        """Registers a call of a device; raises if the call comes after the deadline."""
        self._count()
        self._called = name
        if name != MACHINE:
            self._check()

    def _check(self) -> None:
        if self._clock.now() > self._deadline:
            raise self._late()

    def _count(self) -> None:
        """Adds the time since the last count to the device called last."""
        self._spent[self._called] += self._lap.lap()

    def _late(self) -> DeviceError:
        """The error of a late squeeze; names the device that exceeded its expected time by most."""
        self._count()
        spent = self._spent
        expected = {ARM: self._expected.arm_s, GRIPPER: self._expected.gripper_s, MACHINE: 0.0}
        slowest = max(spent, key=lambda name: spent[name] - expected[name])
        device = slowest if slowest == MACHINE else f"the {slowest}"
        problem = (
            f"the squeeze is not done after {sum(spent.values()):.1f} s: {device} took "
            f"{spent[slowest]:.1f} s, {expected[slowest]:.1f} s are usual; {REMEDIES[slowest]}"
        )
        return MotionRefusedError(problem) if slowest == ARM else GripperStateError(problem)


class _Watched:
    """A device whose calls are registered by a watch."""

    def __init__(self, device: object, name: str, watch: Watch) -> None:
        self._device, self._name, self._watch = device, name, watch

    def __getattr__(self, attribute: str) -> Any:
        self._watch.call(self._name)
        return getattr(self._device, attribute)
