"""A SCHUNK EGU or EGK with Modbus RTU as a state machine over simulated time; no I/O, no clock.

It behaves as the sources of `drivers.schunk.registers` say. Where they are unclear, it behaves adversely, so
that a driver that relies on an assumption fails: a contact while positioning is an error, an outcome shows
late, a grip cannot be changed while something is held.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from drivers.schunk import registers as schunk
from drivers.schunk.registers import PARAMETERS, Command, Control, Input, Output, Status, is_soft
from drivers.sim.devices.jaws import Fingers

# Silence that causes ERR_COMM_LOST; bkstools pauses for 0.5 s, users report that 2 s are too long.
SILENCE_S = 1.0
MESSAGES = 32  # [CM] 4.2: sys_msg_req selects one of 0 to 31

_BY_ADDRESS = {parameter.address: parameter for parameter in PARAMETERS.values()}


class Module(NamedTuple):
    """Parameters of one model that are read-only and not in the model's profile."""

    module_type: int
    grip_mm_s: float  # velocity of a grip with 100 percent of the force
    allowed_n: float  # largest force of a StrongGrip; 0: the module has none
    mass_kg: float


# [DUMP], with the limits of the opening as delivered.
MODULES = {
    "schunk-egu": Module(schunk.EGU_60_M_B, 25.0, 1300.0, 2.9),
    "schunk-egk": Module(schunk.EGK_25_M_B, 20.0, 0.0, 0.62),
}

# The command of a motion has the name of its control bit.
_COMMANDS = {command.value: command.name for command in Command}


# Status bits that are set at the end of a motion; none for a blocked motion, which ends in an error.
REACHED = Status.SUCCESS | Status.POSITION_REACHED
EMPTY = Status.NO_WORKPIECE
HELD = Status.SUCCESS | Status.GRIPPED
WRONG = Status.WRONG_WORKPIECE | Status.GRIPPED
BLOCKED = Status(0)

# Outcomes that correspond to gOBJ 0 to 3.
STATES = (Status(0), REACHED, HELD, EMPTY)
# Counterparts of a Robotiq gripper's over temperature, and of its major faults.
OVER_TEMPERATURE, LEAST_MAJOR = 0x08, 0x0A
TOO_HOT, SUPPLY = 0x6D, 0x74


class SchunkModel(Fingers):
    """A SCHUNK gripper with a brake, after power-up. Times are simulated seconds and never go back."""

    CYCLE_S = 0.002
    MODEL = "schunk-egu"
    silence_s = SILENCE_S  # longest silence of the host that is no fault

    def _begin(self) -> None:
        self.module = MODULES[self.profile.model]
        self.written: list[str] = []  # names of parameters written so far
        self._heard_s = 0.0
        self._outcome = REACHED  # outcome of the current motion
        self._positioning = False  # whether the last command was a move, not a grip
        self._messages: list[str] = []
        self._settings: dict[str, tuple[float | bytes, ...]] = {}

    def _forget(self) -> None:
        """Resets to the state after a power failure: an unacknowledged error, all control bits 1 ([DUMP])."""
        self._settings = {name: one.unpack(bytes(216)) for name, one in PARAMETERS.items()}
        self._settings.update({name: (value,) for name, value in self._facts().items()})
        self._control, self._output = Control(0xFFFFFFFF), Output(Control(0xFFFFFFFF))
        self._status, self._warning, self._additional = Status(0), 0, 0
        self._halt()
        self._fail(schunk.FAST_STOP)

    def _facts(self) -> dict[str, float | bytes]:
        module, profile = self.module, self.profile
        stroke_mm = profile.stroke_um / 1000
        return {
            "module_type": module.module_type,
            "fieldbus_type": 7,
            "max_phys_stroke": stroke_mm,
            "min_pos": 0.0,
            "max_pos": stroke_mm,
            "min_vel": profile.speed_mm_s[0],
            "max_vel": profile.speed_mm_s[1],
            "max_grp_vel": module.grip_mm_s,
            "min_grp_force": profile.force_n[0],
            "max_grp_force": profile.force_n[1],
            "max_allow_force": module.allowed_n,
            "dead_load_kg": module.mass_kg,
            "wp_release_delta": 5.0,
            "grp_prepos_delta": 5.0,
            "grp_pos_margin": 2.0,
            "wp_lost_dst": 1.0,
            "meas_lgc_temp": 35.0,
            "meas_lgc_volt": 24.0,
            "meas_mot_volt": 24.0,
            "baudrate": 115200,
            "slave_id": 12,
            "ctrl_authority": 2,
            "serial_no_num": 1,
            "serial_no_txt": b"SIMULATED       ",
            "order_no_txt": b"0               ",
            "sw_version_txt": b"5.3.1                 ",
            "sw_version_num": 503,
        }

    # -- parameters -------------------------------------------------------------------------------

    def read(self, name: str, now_s: float) -> bytes:
        """Returns the bytes of a parameter as of the last refresh before `now_s`."""
        self.next_request(now_s)
        self._refresh(now_s)
        return PARAMETERS[name].pack(*self._values(name))

    def write(self, name: str, data: bytes, now_s: float) -> None:
        """Writes a parameter, and executes the command in it, if any."""
        self.next_request(now_s)
        self.advance(now_s)
        self.written.append(name)
        values = PARAMETERS[name].unpack(data)
        self._settings[name] = values
        if name == "plc_sync_output":
            self._obey(Output.of(values))
        elif name == "command_code":
            self._settings[name] = (0,)
            self._obey_code(int(values[0]))

    def _values(self, name: str) -> tuple[float | bytes, ...]:
        if name == "plc_sync_input":
            return self._plc_sync_input()
        live: dict[str, tuple[float | bytes, ...]] = {
            "plc_sync_output": self._output,
            "err_code": (self._error,),
            "wrn_code": (self._warning,),
            "actual_pos": (self._here(),),
            "actual_vel": (self._stroke.rate if self._now < self._stroke.end_s else 0.0,),
            "system_uptime": (int(self._now),),
            "sys_msg_buffer": (self._message().encode("ascii").ljust(214),),
        }
        return live.get(name, self._settings[name])

    def _plc_sync_input(self) -> Input:
        status, stroke_um = self._status, self.profile.stroke_um
        misstated = self._misstated(moving=not status & Status.OUTCOMES)
        if misstated is not None:
            status = status & ~Status.OUTCOMES | STATES[misstated]
        closed_um = self._misread(stroke_um - int(1000 * self._here()), stroke_um)
        return Input(status, stroke_um - closed_um, 0, self._error, self._warning, self._additional)

    def _message(self) -> str:
        """Returns the message that `sys_msg_req` selects (0: the newest), or an empty text."""
        wanted = int(self._settings["sys_msg_req"][0])
        return self._messages[-1 - wanted] if wanted < len(self._messages) else ""

    def _value(self, name: str) -> float:
        (value,) = self._settings[name]
        return float(value)

    def next_request(self, now_s: float) -> None:
        """Counts a request; makes a ready device fail if the silence before exceeded `silence_s`."""
        super().next_request(now_s)
        lost_s = self._heard_s + self.silence_s
        if lost_s < now_s and self._status & Status.READY:
            self.advance(lost_s)
            self._fail(schunk.COMM_LOST)
        self._heard_s = now_s

    def _log(self, text: str) -> None:
        self._messages = [*self._messages[1 - MESSAGES :], f"{self._now:.3f} s: {text}"]

    # -- mishaps ----------------------------------------------------------------------------------

    def fail(self, code: int, now_s: float) -> None:
        """Starts an error: the fingers stop, and the brake holds them until the error is acknowledged."""
        self.advance(now_s)
        self._fail(code)

    def _report(self, code: int, now_s: float) -> None:
        if code == OVER_TEMPERATURE:
            self.fail(TOO_HOT, now_s)
        elif code >= LEAST_MAJOR:
            self.fail(SUPPLY, now_s)

    def _dropped(self) -> None:
        """Called when the held part is lost: the fingers go on closing to the end of their range."""
        gripping = self._status & (Status.GRIPPED | Status.READY)
        if gripping == Status.GRIPPED | Status.READY:
            self._status &= ~(Status.GRIPPED | Status.SUCCESS)
            speed_mm_s = self.module.grip_mm_s
            self._go(self._value("min_pos"), speed_mm_s, Status.WORKPIECE_LOST, meets=False)

    def _fail(self, code: int) -> None:
        self._halt()
        self._error = code
        self._status = self._status & Status.RECEIVED_TOGGLE | Status.ERROR | Status.GPE_ACTIVE
        self._log(schunk.ERRORS[code].partition(";")[0])

    # -- commands ---------------------------------------------------------------------------------

    def _obey(self, output: Output) -> None:
        """Executes the commands in a control word.

        A bit that changes to 1 is a command. When the repeat toggle changes, each motion bit that is 1 is a
        command again. `NO_FAST_STOP` stops the fingers when it changes to 0; while it is 0, other bits
        are ignored.
        """
        old, new = self._control, output.control
        self._control, self._output = new, output
        risen = new & ~old
        if (old ^ new) & Control.REPEAT_TOGGLE:
            risen |= new & Control.MOTIONS
        if not new & Control.NO_FAST_STOP:
            if old & Control.NO_FAST_STOP:
                self._received()
                self._fail(schunk.FAST_STOP)
        elif risen & Control.ACKNOWLEDGE:
            self._acknowledge()
        elif risen & Control.STOP:
            self._controlled_stop()
        elif risen & Control.MOTIONS:
            self._command(risen & Control.MOTIONS, output)

    def _obey_code(self, code: int) -> None:
        if code == Command.ACKNOWLEDGE:
            self._acknowledge()
        elif code == Command.FAST_STOP:
            self._received()
            self._fail(schunk.FAST_STOP)
        elif code == Command.STOP:
            self._controlled_stop()
        elif code in _COMMANDS:
            side = Control.GRIP_FROM_INSIDE if self._value("grp_dir") else Control(0)
            place, speed = (round(1000 * self._value(name)) for name in ("set_pos", "set_vel"))
            asked = Output(side, place, speed, round(self._value("set_force")))
            self._command(Control[_COMMANDS[code]], asked)

    def _received(self) -> None:
        self._status = (self._status ^ Status.RECEIVED_TOGGLE) & ~(Status.OUTCOMES | Status.WARNING)
        self._warning = self._additional = 0

    def _refuse(self, reason: int) -> None:
        self._halt()
        self._status |= Status.NOT_FEASIBLE | Status.WARNING
        self._warning, self._additional = schunk.NOT_FEASIBLE_WARNING, reason
        self._log(f"not feasible: {schunk.NOT_FEASIBLE[reason]}")

    def _acknowledge(self) -> None:
        outcome = self._status & Status.OUTCOMES
        self._received()
        if self._status & Status.ERROR:
            outcome = Status.GRIPPED if self._gripping else Status(0)
            self._error = 0
            self._status &= ~(Status.ERROR | Status.GPE_ACTIVE)
        self._status |= outcome
        self._status |= Status.READY | Status.CONTROL_AUTHORITY

    def _controlled_stop(self) -> None:
        self._received()
        if self._status & Status.READY:
            self._halt()
            self._status |= REACHED
        else:
            self._refuse(0x06)

    def _command(self, command: Control, output: Output) -> None:
        """Executes a motion (one of `MOTIONS`) with the values of an output, or refuses it with a warning."""
        position_mm, speed_mm_s = output.position_um / 1000, output.velocity_um_s / 1000
        inside, percent = output.control & Control.GRIP_FROM_INSIDE, output.force_percent
        gripped = bool(self._status & Status.GRIPPED)
        under_way = self._ends_s < math.inf
        self._received()
        moves = command in (Control.MOVE_ABSOLUTE, Control.MOVE_RELATIVE)
        if command == Control.MOVE_RELATIVE:
            position_mm += self._here()
        lowest, highest = self._value("min_pos"), self._value("max_pos")
        slowest, fastest = self.profile.speed_mm_s
        positions = moves or command == Control.GRIP_AT_POSITION
        reasons = {
            0x06: not self._status & Status.READY,
            0x0A: command.bit_count() > 1,
            0x0E: command == Control.RELEASE and not gripped,
            0x0F: command != Control.RELEASE and gripped,
            # A move replaces a move; nothing else replaces anything (bkstools,
            # demo_interrupt_movement).
            0x12: under_way and not self._positioning,
            0x15: under_way and not moves,
            0x10: positions and not lowest <= position_mm <= highest,
            0x13: moves and not slowest <= speed_mm_s <= fastest,
            0x29: command in (Control.GRIP, Control.GRIP_AT_POSITION)
            and not 50 <= percent <= (200 if self.module.allowed_n else 100),
        }
        reason = next((code for code, holds in reasons.items() if holds), None)
        if reason is not None:
            self._refuse(reason)
            return
        self._positioning = moves
        if moves:
            self._go(position_mm, speed_mm_s, REACHED)
        elif command == Control.RELEASE:
            released_mm = self._here() + self._value("wp_release_delta")
            self._go(min(released_mm, highest), fastest, REACHED)
        else:
            soft = is_soft(self.module.module_type) and speed_mm_s > 0.0
            rate = speed_mm_s if soft else self.module.grip_mm_s * min(percent, 100) / 100
            expected = position_mm if command == Control.GRIP_AT_POSITION else None
            self._go(highest if inside else lowest, rate, EMPTY, expected=expected, grips=True)

    # -- motion -----------------------------------------------------------------------------------

    def _go(
        self,
        target_mm: float,
        speed_mm_s: float,
        outcome: Status,
        *,
        expected: float | None = None,
        grips: bool = False,
        meets: bool = True,
    ) -> None:
        self._start(target_mm, speed_mm_s, meets=meets)
        self._outcome = outcome
        if self._meets:
            margin_mm = self._value("grp_pos_margin")
            fits = expected is None or abs(self._stroke.stop - expected) <= margin_mm
            self._outcome = BLOCKED if not grips else HELD if fits else WRONG
        self._ends_s += self._lag()

    def _arrived(self) -> None:
        if self._outcome == BLOCKED:
            self._fail(schunk.MOVE_BLOCKED)
        self._status |= self._outcome


class SchunkRegisters:
    """The parameters at their wire addresses, for `drivers.sim.wire.modbus.answer`.

    Args:
        device: the gripper.
        now: simulated seconds.
    """

    functions = frozenset({3, 16})  # [CM]: no others are supported

    def __init__(self, device: SchunkModel, now: Callable[[], float]) -> None:
        self._device = device
        self._now = now

    def serves(self, address: int, count: int) -> bool:
        """Whether the registers are exactly those of one parameter."""
        parameter = _BY_ADDRESS.get(address)
        return parameter is not None and parameter.registers == count

    def read(self, address: int, count: int) -> bytes:
        """Reads the registers of a parameter."""
        del count
        return self._device.read(_BY_ADDRESS[address].name, self._now())

    def write(self, address: int, data: bytes) -> bool:
        """Writes a parameter; returns False, and writes nothing, if it is read-only.

        It also returns False if the registers are not exactly those of one parameter.
        """
        if not self.serves(address, len(data) // 2):
            return False
        parameter = _BY_ADDRESS[address]
        if parameter.writable:
            self._device.write(parameter.name, data, self._now())
        return parameter.writable
