"""The jaws of one gripper: strokes that are waited for, and strokes that continue while the hand moves.

No stroke is requested before the gripper has reported that it is ready: at rest, or moving to the last
request.
"""

from collections.abc import Callable

from drivers.ports import Gripper, GripperState, ObjectState, Settled
from runtime.devices.clock import Lap, SystemClock
from runtime.execution import safety
from runtime.execution.reading import check_fresh, check_opened, check_passed, check_set, is_open
from runtime.execution.strokes import Stroke
from runtime.table import CLEAR_MM, LEAD_MM, Calibration, Push, Squeeze, Timing

# Time between two polls of moving jaws; time beyond a stroke for which they are polled.
GLANCE_S, LATE_S = 0.005, 0.3


class Jaws:
    """Opens and closes the jaws of one gripper, and tracks whether they may hold something.

    `may_hold` is true at first, and after each closing motion, until the jaws have opened.

    Args:
        gripper: the gripper.
        clock: the clock of the cell.
        calibration: the map from nominal to true widths.
        timing: states the speed of jaws that touch nothing.
    """

    def __init__(
        self, gripper: Gripper, clock: SystemClock, calibration: Calibration, timing: Timing
    ) -> None:
        self.gripper, self.calibration, self.profile = gripper, calibration, calibration.profile
        self.may_hold = True
        self.open_mm = 0.0  # width at which the jaws last stood open
        # target of moving jaws; None: they do not move
        self.asked: int | None = None
        self._clock, self._timing = clock, timing

    @property
    def holds(self) -> bool:
        """Whether the jaws may hold something, and are not moving to release it."""
        return self.may_hold and self.asked is None

    def ready(self) -> GripperState:
        """Reads the gripper and checks that it may be moved; raises the errors of `safety.ready_gripper`."""
        return safety.ready_gripper(self.gripper, self.asked)

    def open(self, squeeze: Squeeze) -> None:
        """Makes sure that the jaws are open as wide as the squeeze requires; collision checks rely on it.

        Jaws that are as wide already, or on their way, get no request.
        """
        self.set_out(squeeze)
        self.wait()

    def set_out(self, squeeze: Squeeze, *, fast: bool = False) -> None:
        """Starts to open empty jaws, and returns at once; `open` waits for them."""
        request = self.calibration.opening_um(squeeze.opening_um)
        if self.asked == request:
            return
        state = self.ready()
        if self.asked is None and self._stands_open(state, request):
            return
        self._ask(request, self._timing.fastest_mm_s if fast else _slow(squeeze), squeeze)

    def _stands_open(self, state: GripperState, request: int) -> bool:
        """Whether a state just read shows that the jaws opened as requested; if so, updates `open_mm`."""
        arrived = state.object is ObjectState.AT_TARGET
        stands = state.target_um == request and arrived and not self.may_hold
        stands = stands and is_open(state.width_um, request, self.calibration)
        if stands:
            self.open_mm = self.width_mm(state.width_um)
        return stands

    def _ask(self, request: int, speed_mm_s: float, squeeze: Squeeze) -> None:
        """Sends the jaws to the reading `request`, um, with the squeeze's force; they may be moving."""
        self.asked = request
        self.gripper.move(request, speed_mm_s, squeeze.force_mn / 1000)

    def wait(self) -> None:
        """Waits until moving jaws have stopped, and checks that they are open as requested."""
        if self.asked is None:
            return
        settled, request = self.gripper.wait(), self.asked
        self.asked = None
        check_opened(settled, request, self.calibration)
        self.may_hold = False
        self.open_mm = self.width_mm(settled.width_um)

    def set_to(self, push: Push, squeeze: Squeeze) -> None:
        """Sets empty jaws to the opening of a push, with speed and force of the squeeze that follows it."""
        request = self.calibration.nearest_um(push.opening_um)
        settled = self.stroke(Stroke(request, _slow(squeeze), squeeze.force_mn / 1000, 0.0))
        self.may_hold = False
        check_fresh(settled, request)
        check_set(settled.width_um, request, self.calibration)
        self.open_mm = self.width_mm(settled.width_um)

    def open_to(self, squeeze: Squeeze, width_mm: float) -> None:
        """Opens to a width at the squeeze's speed, and waits until the jaws are there."""
        request = self.calibration.opening_um(round(1000 * width_mm))
        self._ask(request, _slow(squeeze), squeeze)
        self.wait()

    def set_free(self, squeeze: Squeeze, following: Squeeze, free_mm: float) -> None:
        """Starts to open the jaws for the next squeeze, and returns once they are clear of the part.

        Until then the jaws open at the speed of the squeeze that ends. They go on opening after the return:
        fast, if the gripper accepts a request during a motion and the rest of the way is long enough. If the
        jaws are not clear in time, the method waits until they have opened (`wait`).

        Args:
            squeeze: the squeeze that ends, whose speed and force apply.
            following: the next squeeze, to whose opening the jaws open.
            free_mm: width at which the jaws are clear of the part.
        """
        request = self.calibration.opening_um(following.opening_um)
        self._ask(request, _slow(squeeze), squeeze)
        free = self.calibration.opening_um(round(1000 * free_mm))
        seen = self._on_the_way(lambda reading: reading >= free, CLEAR_MM / _slow(squeeze))
        if seen is None:
            self.wait()
            return
        left_mm = following.opening_um / 1000 - self.width_mm(seen)
        if self.profile.streams and left_mm > LEAD_MM:
            self._ask(request, self._timing.fastest_mm_s, squeeze)

    def _on_the_way(self, there: Callable[[int], bool], seconds: float) -> int | None:
        """Polls moving jaws until `there` accepts their reading, um; returns that reading.

        Returns None if that takes longer than `seconds` + `LATE_S`.
        """
        watch, left_s = Lap(self._clock), seconds + LATE_S
        while True:
            left_s -= watch.lap()
            state = self.ready()
            if state.target_um == self.asked and there(state.width_um):
                return state.width_um
            if left_s < 0.0:  # `wait` has its own deadline, and reports what is wrong
                return None
            self._clock.sleep(GLANCE_S)

    def arrives(self, stroke: Stroke) -> bool:
        """Closes to an intermediate width, and stops; returns False if the jaws met something earlier."""
        return check_passed(self.stroke(stroke), stroke.request_um, self.calibration)

    def passes(self, stroke: Stroke) -> bool:
        """Closes to an intermediate width without a stop; returns False if the jaws met something earlier.

        Returns True as soon as the jaws are about to arrive, so that the next stroke can follow at once.
        """
        self.ready()
        self.may_hold, self.asked = True, stroke.request_um
        self.gripper.move(stroke.request_um, stroke.speed_mm_s, stroke.force_n)
        end_mm = self.width_mm(stroke.request_um)
        near = self.calibration.nearest_um(round(1000 * (end_mm + LEAD_MM)))
        stroke_s = (self.open_mm - end_mm) / self._timing.fastest_mm_s
        if self._on_the_way(lambda reading: reading <= near, stroke_s) is not None:
            return True
        self.asked = None
        return check_passed(self.gripper.wait(), stroke.request_um, self.calibration)

    def stroke(self, stroke: Stroke) -> Settled:
        """Performs a stroke, and waits until the jaws have settled; returns their reading."""
        asked, self.may_hold, self.asked = self.asked, True, None
        return safety.stroke(self.gripper, *stroke[:3], asked)

    def width_mm(self, reading_um: int) -> float:
        """Returns the true width at a reading, mm."""
        return self.calibration.width_um(reading_um) / 1000


def _slow(squeeze: Squeeze) -> float:
    """The squeeze's speed, mm/s."""
    return squeeze.speed_um_s / 1000
