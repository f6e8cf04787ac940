"""Registers of the AG and PGC series.

Sources: [AG] "AG-95 Gripper Short Manual (Modbus-RTU)", [PGC] "PGC-50 Gripper Short Manual", and [PGE] "PGE-2
Gripper User Manual" V1.0 (2021). The registers are those of [PGC]; [PGE] and the manual of the PGC series
list the same. Every register is one word; functions 03, 06 and 16 are served ([PGE] 3.3.2).
"""

from enum import IntEnum

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

# Values of INITIALISATION: to the end that `DIRECTION` names; to both ends, to calibrate the stroke.
INITIALISE, CALIBRATE = 0x01, 0xA5
FULL = 1000  # of POSITION: a whole stroke
LEAST_FORCE, LEAST_SPEED, MOST = 20, 1, 100  # per cent


class Initialised(IntEnum):
    """Values of the register `INITIALISED`: whether the gripper is initialised."""

    NO = 0
    YES = 1
    IN_PROGRESS = 2


class Grip(IntEnum):
    """Values of the register `GRIP`: whether the fingers move, and what ended their motion."""

    MOVING = 0
    AT_POSITION = 1  # nothing was met
    CAUGHT = 2  # the fingers stopped before the requested position
    DROPPED = 3  # at the position, because the held part is gone
