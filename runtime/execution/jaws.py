"""The jaws of one gripper: strokes that are waited for, and strokes that go on while the hand moves.

No stroke is asked for before the gripper has answered that it is ready: at rest, or on its way to where these
jaws were asked to go.
"""

from collections.abc import Callable

from drivers.ports import Gripper, GripperState, ObjectState, Settled
from runtime.devices.clock import Lap, SystemClock
from runtime.execution import safety
from runtime.execution.reading import check_fresh, check_opened, check_passed, check_set, is_open
from runtime.execution.strokes import Stroke
from runtime.table import CLEAR_MM, LEAD_MM, Calibration, Push, Squeeze, Timing

# Between two looks at jaws on their way; how much longer than a stroke takes they are looked at.
GLANCE_S, LATE_S = 0.005, 0.3


class Jaws:
    """The jaws; `may_hold` tells whether they may hold something: they have not opened since they closed.

    Args:
        gripper: whose jaws they are.
        clock: of the cell.
        calibration: nominal to true widths.
        timing: says how fast they go where they touch nothing.
    """

    def __init__(
        self,
        gripper: Gripper,
        clock: SystemClock,
        calibration: Calibration,
        timing: Timing,
    ) -> None:
        self.gripper, self.calibration, self.profile = gripper, calibration, calibration.profile
        self.may_hold = True
        self.open_mm = 0.0  # where they stood open last
        # where jaws on their way were asked to go; None: they are not
        self.asked: int | None = None
        self._clock, self._timing = clock, timing

    @property
    def holds(self) -> bool:
        """Whether they may hold something, and are not on their way to let go of it."""
        return self.may_hold and self.asked is None

    def ready(self) -> GripperState:
        """Read the gripper, as `safety.ready_gripper`."""
        return safety.ready_gripper(self.gripper, self.asked)

    def open(self, squeeze: Squeeze) -> None:
        """Have the jaws open as wide as the squeeze wants them; the check for collisions counts on it.

        Nothing moves where they stand there already, or are on their way.
        """
        self.set_out(squeeze)
        self.wait()

    def set_out(self, squeeze: Squeeze, *, fast: bool = False) -> None:
        """Ask jaws that hold nothing to open so wide, and return at once; `open` waits for them."""
        request = self.calibration.opening_um(squeeze.opening_um)
        if self.asked == request:
            return
        state = self.ready()
        if self.asked is None and self._stands_open(state, request):
            return
        self._ask(request, self._timing.fastest_mm_s if fast else _slow(squeeze), squeeze)

    def _stands_open(self, state: GripperState, request: int) -> bool:
        """Whether a fresh reading shows jaws that opened as they were asked to, and still stand there."""
        arrived = state.object is ObjectState.AT_TARGET
        stands = state.target_um == request and arrived and not self.may_hold
        stands = stands and is_open(state.width_um, request, self.calibration)
        if stands:
            self.open_mm = self.width_mm(state.width_um)
        return stands

    def _ask(self, request: int, speed_mm_s: float, squeeze: Squeeze) -> None:
        """Ask the jaws to go somewhere, also from where they go."""
        self.asked = request
        self.gripper.move(request, speed_mm_s, squeeze.force_mn / 1000)

    def wait(self) -> None:
        """Wait for jaws that were asked to open, and check that they did."""
        if self.asked is None:
            return
        settled, request = self.gripper.wait(), self.asked
        self.asked = None
        check_opened(settled, request, self.calibration)
        self.may_hold = False
        self.open_mm = self.width_mm(settled.width_um)

    def set_to(self, push: Push, squeeze: Squeeze) -> None:
        """Bring the jaws, with nothing between them, to the opening of a push before a squeeze."""
        request = self.calibration.nearest_um(push.opening_um)
        settled = self.stroke(Stroke(request, _slow(squeeze), squeeze.force_mn / 1000, 0.0))
        self.may_hold = False
        check_fresh(settled, request)
        check_set(settled.width_um, request, self.calibration)
        self.open_mm = self.width_mm(settled.width_um)

    def open_to(self, squeeze: Squeeze, width_mm: float) -> None:
        """Open to a width at the squeeze's speed, and wait until the jaws stand there."""
        request = self.calibration.opening_um(round(1000 * width_mm))
        self._ask(request, _slow(squeeze), squeeze)
        self.wait()

    def set_free(self, squeeze: Squeeze, following: Squeeze, free_mm: float) -> None:
        """Open at the squeeze's speed until the jaws are free, then as fast as they can, and return."""
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
        """Look at jaws on their way until they are somewhere; the reading, None where they are late."""
        watch, left_s = Lap(self._clock), seconds + LATE_S
        while True:
            left_s -= watch.lap()
            state = self.ready()
            if state.target_um == self.asked and there(state.width_um):
                return state.width_um
            if left_s < 0.0:  # `wait` has a deadline of its own, and says what is wrong
                return None
            self._clock.sleep(GLANCE_S)

    def arrives(self, stroke: Stroke) -> bool:
        """Close to an intermediate width and stop there; whether the jaws got there, or met something."""
        return check_passed(self.stroke(stroke), stroke.request_um, self.calibration)

    def passes(self, stroke: Stroke) -> bool:
        """Close towards an intermediate width, as `arrives`, but return just before the jaws stop there."""
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
        """Close, and wait until the jaws have settled."""
        asked, self.may_hold, self.asked = self.asked, True, None
        return safety.stroke(self.gripper, *stroke[:3], asked)

    def width_mm(self, reading_um: int) -> float:
        """The opening at a reading."""
        return self.calibration.width_um(reading_um) / 1000


def _slow(squeeze: Squeeze) -> float:
    """The squeeze's speed, mm/s."""
    return squeeze.speed_um_s / 1000
