"""Converts between widths and counts of a 2F-85 (3 open, 230 closed), for tests in counts."""

import numpy as np

from drivers.ports import GripperState, ObjectState
from drivers.robotiq.counts import Counts
from drivers.robotiq.registers import fault_text
from runtime.table import PROFILES, Calibration, DecisionMap
from runtime.table import decide as look_up

COUNTS = 256
PROFILE = PROFILES["robotiq-2f-85"]
SETTINGS = Counts(PROFILE)  # counts of positions, speeds and forces
CALIBRATION = Calibration(PROFILE)


def width_um(count: int) -> int:
    """The width at a count [um]; counts beyond an end of the travel have the width of that end."""
    return min(max(PROFILE.counted_um(count), 0), PROFILE.stroke_um)


def count_of(width: int) -> int:
    """The count whose width is nearest to a width [um]."""
    return PROFILE.counts[1] - PROFILE.step(width)


def decide(decided: DecisionMap, count: int, felt: bool) -> int:
    """Returns the branch that a node's decision map assigns to a count and object flag, or `REJECT`."""
    return look_up(decided, width_um(count), felt)


def by_count(decided: DecisionMap) -> tuple[int, ...]:
    """Returns the branch of each count from 0 to 255 by the width alone (`DecisionMap.either`)."""
    return tuple(decided.either.at(width_um(count)) for count in range(COUNTS))


def state(count, flag=3, echo=0, *, active=True, moving=False, fault=0) -> GripperState:
    """Returns a state of the gripper; `count` is the position, `echo` the echoed request [counts]."""
    text = fault_text(fault).partition(";")[0] if fault else ""
    target = SETTINGS.target_um(echo)
    said = f"0x{fault:02X}, {text}" if fault else ""
    width = SETTINGS.width_um(count)
    return GripperState(active, moving, fault, said, ObjectState(flag), target, width, 0)


def label_of(clusters, readings):
    """Returns, for each of the readings (n,), the index of the cluster that contains it, or -1 if none does.

    `clusters` is a `Partition`.
    """
    readings = np.asarray(readings)[:, None]
    inside = (clusters.low <= readings) & (readings <= clusters.high)
    return np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
