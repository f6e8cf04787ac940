"""The parameters of a SCHUNK EGU or EGK as data, its control and status bits, and its codes.

A parameter is read and written as a whole. The address of its first register is the parameter's code minus 1.
Its elements are little-endian, unlike Modbus registers. `plc_sync_input` and `plc_sync_output` are what a
fieldbus would exchange cyclically.

Sources: [CM] Commissioning Manual EGU/EGK, Modbus RTU, firmware 5.3.1, and [PN] the manual of the EGU with
PROFINET (1514033), both as SCHUNK's repository `schunk_mechatronic_gripper` cites them, with the section
numbers given there; [BKS] SCHUNK's `bkstools` 0.0.2.31; [DUMP] the parameters of an EGU 60 and an EGK 25 in
that repository (schunk_gripper_dummy/config/grippers).
"""

import struct
from enum import IntEnum, IntFlag
from typing import NamedTuple, Self

UNIT, BAUD, PARITY = 12, 115200, "E"  # [CM]: slave 12, 115200 bit/s, 8E1, as delivered


class Parameter(NamedTuple):
    """One parameter; `kind` is the format of its elements for the module `struct`, without byte order."""

    code: int
    name: str
    kind: str
    writable: bool
    meaning: str

    @property
    def address(self) -> int:
        """Wire address of the parameter's first register ([CM], example: 0x0040 is requested as 0x003F)."""
        return self.code - 1

    @property
    def registers(self) -> int:
        """Number of the parameter's registers; the last may have an unused byte."""
        return (struct.calcsize(f"<{self.kind}") + 1) // 2

    def pack(self, *values: float | bytes) -> bytes:
        """Packs elements into the bytes of the parameter's registers."""
        return struct.pack(f"<{self.kind}", *values).ljust(2 * self.registers, b"\0")

    def unpack(self, data: bytes) -> tuple[float, ...]:
        """Unpacks the parameter's elements from the bytes of its registers."""
        return struct.unpack_from(f"<{self.kind}", data)


def _parameters(*rows: tuple[int, str, str, bool, str]) -> dict[str, Parameter]:
    return {name: Parameter(code, name, *rest) for code, name, *rest in rows}  # type: ignore[arg-type]


READ, WRITE = False, True
PARAMETERS = _parameters(
    (0x0040, "plc_sync_input", "IiiHBB", READ, "[PN] 2.1.1: status, position, diagnosis"),
    (0x0048, "plc_sync_output", "Iiii", WRITE, "[PN] 2.1.1: control, position, velocity, force"),
    (0x0100, "command_code", "H", WRITE, "[BKS] bks_move, bks_grip: a command (`Command`)"),
    (0x0108, "system_state", "I", READ, "[BKS]"),
    (0x0110, "ctrl_authority", "B", READ, "[BKS]"),
    (0x0118, "err_code", "B", READ, "[CM] 4.2: error"),
    (0x0120, "wrn_code", "B", READ, "[CM] 4.2: warning"),
    (0x0128, "sys_msg_req", "H", WRITE, "[CM] 4.2: which message is read next, 0 the newest"),
    (0x0130, "sys_msg_buffer", "214s", READ, "[CM] 4.2: the message, ASCII"),
    (0x0200, "set_pos", "f", WRITE, "[BKS] bks_move: target, mm"),
    (0x0208, "set_vel", "f", WRITE, "[BKS] bks_move: mm/s"),
    (0x0218, "set_acc", "f", WRITE, "[BKS] mm/s2, for SCHUNK's service"),
    (0x0220, "set_force", "f", WRITE, "[BKS] bks_grip: percent"),
    (0x0228, "grp_dir", "?", WRITE, "[BKS] bks_grip: 0 from outside, 1 from inside"),
    (0x0230, "actual_pos", "f", READ, "[CM] 4.2: mm"),
    (0x0238, "actual_vel", "f", READ, "[CM] 4.2: mm/s"),
    (0x0240, "actual_cur", "f", READ, "[DUMP] A"),
    (0x0380, "grp_prehold_time", "H", WRITE, "[CM] 4.2: ms of gripping once more, 0 none"),
    (0x03A8, "dead_load_kg", "f", READ, "[CM] 4.2"),
    (0x0500, "module_type", "B", READ, "[BKS] bks_firmware_enums.eGripperType"),
    (0x0528, "wp_lost_dst", "f", WRITE, "[CM] 4.2: mm, 0.1 to 50"),
    (0x0540, "wp_release_delta", "f", WRITE, "[CM] 4.2: mm that a release opens, 1 to 50"),
    (0x0580, "grp_pos_margin", "f", WRITE, "[CM] 4.2: mm about an expected position, 1 to 10"),
    (0x0588, "max_phys_stroke", "f", READ, "[CM] 4.2: mm, without fingers"),
    (0x05A8, "grp_prepos_delta", "f", WRITE, "[CM] 4.2: mm, 1 to 50"),
    (0x0600, "min_pos", "f", WRITE, "[CM] 4.2: lower limit of the opening, mm"),
    (0x0608, "max_pos", "f", WRITE, "[CM] 4.2: upper limit of the opening, mm"),
    (0x0610, "zero_pos_ofs", "f", WRITE, "[CM] 4.2: mm"),
    (0x0628, "min_vel", "f", READ, "[CM] 4.2: mm/s"),
    (0x0630, "max_vel", "f", READ, "[CM] 4.2: mm/s"),
    (0x0650, "max_grp_vel", "f", READ, "[CM] 4.2: mm/s of gripping with 100 percent"),
    (0x0658, "min_grp_force", "f", READ, "[CM] 4.2: N"),
    (0x0660, "max_grp_force", "f", READ, "[CM] 4.2: N, 100 percent"),
    (0x06A8, "max_allow_force", "f", READ, "[CM] 4.2: N of a StrongGrip, EGU only"),
    (0x0840, "meas_lgc_temp", "f", READ, "[CM] 4.2: degC"),
    (0x0870, "meas_lgc_volt", "f", READ, "[CM] 4.2: V"),
    (0x0878, "meas_mot_volt", "f", READ, "[CM] 4.2: V"),
    (0x1000, "serial_no_txt", "16s", READ, "[CM] 4.2"),
    (0x1008, "order_no_txt", "16s", READ, "[CM] 4.2"),
    (0x1020, "serial_no_num", "I", READ, "[CM] 4.2"),
    (0x1100, "sw_build_date", "12s", READ, "[CM] 4.2: fw_app_date"),
    (0x1108, "sw_build_time", "9s", READ, "[CM] 4.2: fw_app_time"),
    (0x1110, "sw_version_num", "H", READ, "[CM] 4.2: fw_app_ver_num"),
    (0x1118, "sw_version_txt", "22s", READ, "[CM] 4.2: fw_app_ver_txt"),
    (0x1130, "fieldbus_type", "B", READ, "[BKS] bks_firmware_enums.eFieldbusType: 7 Modbus RTU"),
    (0x11A0, "baudrate", "I", WRITE, "[CM] 4.2"),
    (0x11A8, "slave_id", "H", WRITE, "[CM] 4.2: 1 to 247"),
    (0x1400, "system_uptime", "I", READ, "[CM] 4.2: s since the start"),
)


EGU_60_M_B, EGK_25_M_B = 0x0B, 0x11  # values of `module_type`
_SOFT = (*range(0x0E, 0x14),)  # module types of an EGK of any size ([BKS] eGripperType)


def is_soft(module_type: int) -> bool:
    """Whether a type of gripper accepts a velocity for gripping: SoftGrip ([CM] 1.2.3)."""
    return module_type in _SOFT


class Control(IntFlag):
    """The used bits of the control double word ([PN] 2.1.1.1; [BKS] SetupControlword)."""

    NO_FAST_STOP = 1 << 0  # "fast stop": clearing it stops; every command needs it
    STOP = 1 << 1
    ACKNOWLEDGE = 1 << 2
    REPEAT_TOGGLE = 1 << 6
    GRIP_FROM_INSIDE = 1 << 7
    RELEASE = 1 << 11
    GRIP = 1 << 12
    MOVE_ABSOLUTE = 1 << 13
    MOVE_RELATIVE = 1 << 14
    GRIP_AT_POSITION = 1 << 16
    MOTIONS = RELEASE | GRIP | MOVE_ABSOLUTE | MOVE_RELATIVE | GRIP_AT_POSITION


class Status(IntFlag):
    """The used bits of the status double word ([PN] 2.1.1.2; [BKS] SetupStatusword)."""

    READY = 1 << 0
    CONTROL_AUTHORITY = 1 << 1
    NOT_FEASIBLE = 1 << 3
    SUCCESS = 1 << 4  # the last command is done
    RECEIVED_TOGGLE = 1 << 5  # changes with each command
    WARNING = 1 << 6
    ERROR = 1 << 7
    NO_WORKPIECE = 1 << 11
    GRIPPED = 1 << 12
    POSITION_REACHED = 1 << 13
    WORKPIECE_LOST = 1 << 16
    WRONG_WORKPIECE = 1 << 17
    GPE_ACTIVE = 1 << 31  # the brake of an M module holds force and position
    FAILURES = NOT_FEASIBLE | WORKPIECE_LOST | WRONG_WORKPIECE
    OUTCOMES = SUCCESS | NO_WORKPIECE | GRIPPED | POSITION_REACHED | FAILURES


class Command(IntEnum):
    """Values of the parameter `command_code` ([BKS] pyschunk eCmdCode, as bks_move and bks_grip use it)."""

    RELEASE = 0x11
    ACKNOWLEDGE = 0x8B
    FAST_STOP = 0x90
    STOP = 0x91
    GRIP_AT_POSITION = 0xAF
    MOVE_ABSOLUTE = 0xB0
    GRIP = 0xB4
    MOVE_RELATIVE = 0xB8


class Input(NamedTuple):
    """Values of the parameter `plc_sync_input`, by which the gripper reports its state.

    Bytes 12, 14 and 15 are error, warning and additional code ([DUMP], [BKS]); [CM] states other positions.
    """

    status: Status
    position_um: int
    reserved: int
    error: int
    warning: int
    additional: int

    @property
    def ready(self) -> bool:
        """Whether the gripper may be moved."""
        return bool(self.status & Status.READY and not self.error)

    @classmethod
    def of(cls, values: tuple[float, ...]) -> Self:
        """Creates an input from the elements of the parameter `plc_sync_input`."""
        status, *rest = map(int, values)
        return cls(Status(status), *rest)


class Output(NamedTuple):
    """Values of the parameter `plc_sync_output`, by which the host commands the gripper."""

    control: Control
    position_um: int = 0
    velocity_um_s: int = 0
    force_percent: int = 0

    @classmethod
    def of(cls, values: tuple[float, ...]) -> Self:
        """Creates an output from the elements of the parameter `plc_sync_output`."""
        control, *rest = map(int, values)
        return cls(Control(control), *rest)


# [PN] 6: each is acknowledged once its cause is gone.
_AGAIN = "remove the cause, then start again with --activate, which acknowledges it"
_SUPPLY = "check the 24 V supply, then start again with --activate"
_HOT = "let it cool down or warm up, then start again with --activate"
FAST_STOP, COMM_LOST, MOVE_BLOCKED = 0xD9, 0xEF, 0xF4
ERRORS = {
    0x28: "the brake test failed (ERR_BT_FAILED); have the gripper serviced",
    0x6C: f"the motor is too cold (ERR_MOT_TEMP_LO); {_HOT}",
    0x6D: f"the motor is too hot (ERR_MOT_TEMP_HI); {_HOT}",
    0x70: f"the electronics are too cold (ERR_LGC_TEMP_LO); {_HOT}",
    0x71: f"the electronics are too hot (ERR_LGC_TEMP_HI); {_HOT}",
    0x72: f"the logic supply is too low (ERR_LGC_VOLT_LO); {_SUPPLY}",
    0x73: f"the logic supply is too high (ERR_LGC_VOLT_HI); {_SUPPLY}",
    0x74: f"the motor supply is too low (ERR_MOT_VOLT_LO); {_SUPPLY}",
    0x75: f"the motor supply is too high (ERR_MOT_VOLT_HI); {_SUPPLY}",
    0xD5: f"the fingers passed the lower limit (ERR_SOFT_LOW); {_AGAIN}",
    0xD6: f"the fingers passed the upper limit (ERR_SOFT_HIGH); {_AGAIN}",
    FAST_STOP: "fast stop, or not acknowledged since power-on (ERR_FAST_STOP); "
    "clear the jaws, then start again with --activate, which acknowledges it",
    0xE4: f"the fingers were too fast (ERR_TOO_FAST); {_AGAIN}",
    COMM_LOST: "nobody asked the gripper anything for too long (ERR_COMM_LOST); "
    "check the cable and the load of this machine, then start again with --activate",
    0xF1: f"positioning took too long (ERR_MOV_ABORT_TO); {_AGAIN}",
    MOVE_BLOCKED: "something blocks the fingers on their way (ERR_MOVE_BLOCKED); "
    "remove it, then start again with --activate",
}
# [PN] 7.4: why a command is not feasible.
NOT_FEASIBLE_WARNING = 0x94
NOT_FEASIBLE: dict[int, str] = {
    0x06: "it is in an error state",
    0x09: "a fast stop holds it",
    0x0A: "several commands at once",
    0x0E: "it grips nothing that could be released",
    0x0F: "it holds a workpiece",
    0x10: "the position is outside min_pos to max_pos",
    0x11: "the position is inside the workpiece",
    0x12: "it is gripping",
    0x13: "the velocity is outside min_vel to max_vel",
    0x15: "it is on its way to a position",
    0x1E: "it is releasing a workpiece",
    0x26: "the release would pass a limit of its position",
    0x27: "the release would go into the workpiece",
    0x28: "it has no brake",
    0x29: "the force is outside what the gripper does",
}


def error_text(code: int) -> str:
    """Returns code, meaning and remedy of an error; an unknown error needs SCHUNK's service ([PN] 6)."""
    unknown = f"unknown error 0x{code:02X}; contact SCHUNK's service"
    return f"0x{code:02X}, {ERRORS.get(code, unknown)}"
