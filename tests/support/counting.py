"""A 2F-85 by its counts, 3 open and 230 closed, for tests that are told in counts."""

import numpy as np

from drivers.ports import GripperState, ObjectState
from drivers.robotiq.counts import Counts
from drivers.robotiq.registers import fault_text
from runtime.table import PROFILES, DecisionMap
from runtime.table import decide as look_up

COUNTS = 256
PROFILE = PROFILES["robotiq-2f-85"]
SETTINGS = Counts(PROFILE)  # counts of positions, speeds and forces


def width_um(count: int) -> int:
    """The width at a count, of which those beyond the ends read as the ends."""
    return min(max(PROFILE.counted_um(count), 0), PROFILE.stroke_um)


def count_of(width: int) -> int:
    """The count whose width is nearest."""
    return PROFILE.counts[1] - PROFILE.step(width)


def decide(decided: DecisionMap, count: int, felt: bool) -> int:
    """What a count means."""
    return look_up(decided, width_um(count), felt)


def by_count(decided: DecisionMap) -> tuple[int, ...]:
    """What each count means, with the flag that it needs."""
    return tuple(decided.either.at(width_um(count)) for count in range(COUNTS))


def state(count, flag=3, echo=0, *, active=True, moving=False, fault=0) -> GripperState:
    """A reading of one."""
    text = fault_text(fault).partition(";")[0] if fault else ""
    target = SETTINGS.target_um(echo)
    said = f"0x{fault:02X}, {text}" if fault else ""
    width = SETTINGS.width_um(count)
    return GripperState(active, moving, fault, said, ObjectState(flag), target, width, 0)


def label_of(clusters, readings):
    """The number of the cluster (n,) of `Partition` that each reading lies in, -1 for none."""
    readings = np.asarray(readings)[:, None]
    inside = (clusters.low <= readings) & (readings <= clusters.high)
    return np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
