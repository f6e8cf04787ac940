"""Grips gauge blocks, slowly and with the least force, and reads the counts at which the fingers rest."""

from collections.abc import Callable, Iterator, Sequence

from drivers.ports import Gripper
from runtime.errors import GripperStateError
from runtime.execution.calibration import Gauge
from runtime.execution.reading import CLOSED_COUNTS, check_fresh
from runtime.execution.safety import ready_gripper
from runtime.execution.strokes import GENTLE_FORCE, GENTLE_SPEED
from runtime.traversal.decision import CLOSING_CONTACT


def measure(
    gripper: Gripper, widths_mm: Sequence[float], grips: int, ask: Callable[[str], object]
) -> Iterator[Gauge]:
    """Grip each block so many times.

    Args:
        gripper: ready.
        widths_mm: the blocks in rising order; 0 for none.
        grips: times.
        ask: shows the operator a sentence and waits.

    Yields:
        A gauge for each block.

    Raises:
        GripperStateError: the gripper is not ready, or closed without meeting the block.
    """
    for width_mm in widths_mm:
        _stroke(gripper, 0, 255)
        if width_mm > 0.0:
            ask(f"Hold the {width_mm:g} mm block between the fingers and press Enter.")
        else:
            ask("Take everything out from between the fingers and press Enter.")
        counts = []
        for _ in range(grips):
            count, flag = _stroke(gripper, CLOSED_COUNTS, GENTLE_SPEED)
            if width_mm > 0.0 and flag != CLOSING_CONTACT:
                raise GripperStateError(
                    f"the fingers closed without meeting the {width_mm:g} mm block; begin again"
                )
            counts.append(count)
            _stroke(gripper, max(count - 25, 0), 0)
        yield Gauge(width_mm, tuple(counts))
    _stroke(gripper, 0, 255)


def _stroke(gripper: Gripper, position_counts: int, speed_counts: int) -> tuple[int, int]:
    ready_gripper(gripper)
    gripper.move(position_counts, speed_counts, GENTLE_FORCE)
    settled = gripper.wait()
    check_fresh(settled, position_counts)
    return settled.position_counts, settled.object_flag
