"""Registers of the AG and PGC series, and what a model's percentages mean.

Sources: [AG] "AG-95 Gripper Short Manual (Modbus-RTU)", [PGC] "PGC-50 Gripper Short Manual", whose series
edition has the same map, and [PGE] "PGE-2 Gripper User Manual" V1.0 (2021), which has it, too. Data sheets:
those of the end effectors of the Dobot CR series. Every register is one word; functions 03, 06 and 16 are
served ([PGE] 3.3.2).
"""

from enum import IntEnum
from typing import NamedTuple

UNIT = 1  # [PGE] 3.3.4.10, as delivered
BAUD = 115200  # 8N1, [PGE] 3.3.4.11 to 3.3.4.13, as delivered

# Control registers, read and write.
INITIALISATION = 0x0100  # [PGC] 2.3.3.1; reads 1 while it initialises
FORCE = 0x0101  # 20 to 100 %, [PGC] 2.3.3.2
POSITION = 0x0103  # 0 closed to 1000 open; the fingers move at once, [PGC] 2.3.3.3
SPEED = 0x0104  # 1 to 100 %, [PGC] 2.3.3.4, whose text says 0x0102 where its table and examples say 0x0104
CONTROL = (INITIALISATION, 5)  # first register and count; 0x0102 is reserved

# States, read only.
INITIALISED = 0x0200  # `Initialised`, [PGE] 3.3.4.5
GRIP = 0x0201  # `Grip`, [PGE] 3.3.4.6
ACTUAL_POSITION = 0x0202  # [PGE] 3.3.4.7
STATUS = (INITIALISED, 3)

# Save, direction of initialisation, slave address, baud rate, stop bits, parity: [PGE] 3.3.4.8 to 3.3.4.13.
SAVE, DIRECTION = 0x0300, 0x0301
SETTINGS = (SAVE, 6)

INITIALISE, CALIBRATE = (
    0x01,
    0xA5,
)  # to the end that `DIRECTION` names; to both ends, to learn the stroke
FULL = 1000  # of POSITION: a whole stroke
LEAST_FORCE, LEAST_SPEED, MOST = 20, 1, 100  # per cent


class Initialised(IntEnum):
    """What `INITIALISED` says."""

    NO = 0
    YES = 1
    IN_PROGRESS = 2


class Grip(IntEnum):
    """What `GRIP` says."""

    MOVING = 0
    AT_POSITION = 1  # nothing was met
    CAUGHT = 2  # the fingers stopped before the position asked for
    DROPPED = 3  # at the position, because what was caught is gone


class Model(NamedTuple):
    """One model; speed and force are taken as linear in their percentages."""

    name: str  # as a job names it
    stroke_mm: float  # of the opening
    stroke_s: float  # that a whole stroke takes at full speed
    weakest_n: float  # force at 20 %
    strongest_n: float

    def speed_mm_s(self, percent: int) -> float:
        """Speed of the opening."""
        return self.stroke_mm / self.stroke_s * percent / MOST

    def speed_percent(self, speed_mm_s: float) -> int:
        """The nearest setting of a speed."""
        return _within(MOST * speed_mm_s * self.stroke_s / self.stroke_mm, LEAST_SPEED)

    def force_percent(self, force_n: float) -> int:
        """The nearest setting of a force."""
        share = (force_n - self.weakest_n) / (self.strongest_n - self.weakest_n)
        return _within(LEAST_FORCE + (MOST - LEAST_FORCE) * share, LEAST_FORCE)

    def position(self, width_mm: float) -> int:
        """The nearest position to an opening."""
        return min(max(round(FULL * width_mm / self.stroke_mm), 0), FULL)

    def width_mm(self, position: int) -> float:
        """The opening at a position."""
        return position * self.stroke_mm / FULL


# Data sheets of AG-95 and PGC-140-50: stroke, opening and closing time, gripping force.
MODELS = {
    model.name: model
    for model in (
        Model("dh-ag95", 95.0, 0.7, 45.0, 160.0),
        Model("dh-pgc140-50", 50.0, 0.7, 40.0, 140.0),
    )
}


def _within(percent: float, least: int) -> int:
    return min(max(round(percent), least), MOST)
