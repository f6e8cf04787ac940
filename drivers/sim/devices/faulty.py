"""Grippers and an arm controller that fail by a schedule."""

import math
import random
from typing import Any

from drivers.abb.codec import Pose
from drivers.dh import registers as dh
from drivers.dh.registers import Grip
from drivers.ports import MOST_COUNT
from drivers.robotiq.registers import OBJ_MOVING
from drivers.schunk.registers import OUTCOMES, PARAMETERS, Input, Status
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.devices.dh import DhModel
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.jaws import Fingers, Surroundings
from drivers.sim.devices.schunk import SchunkModel
from drivers.sim.faults import Channel, Desk, Fault

STALE = "1 1 "  # the acknowledgement of a MoveL
RELEASING = 0x0B
LEAST_MAJOR = 0x0A  # faults that stay in the model; lesser ones only show in readings
OVER_TEMPERATURE = 0x08
# A SCHUNK gripper's counterparts of a Robotiq gripper's over temperature, and of its major faults.
TOO_HOT, SUPPLY = 0x6D, 0x74
# Outcomes of a SCHUNK gripper that correspond to gOBJ 0 to 3.
STATES = (
    Status(0),
    Status.POSITION_REACHED | Status.SUCCESS,
    Status.GRIPPED | Status.SUCCESS,
    Status.NO_WORKPIECE,
)


class FaultyArm(ArmModel):
    """A controller that fails by the desk's schedule; each instruction is one event.

    Args:
        rng: draws displacements of the hand.
        base: see `ArmModel`.
        desk: gives the current faults.
        acceleration: see `ArmModel`.
    """

    def __init__(
        self, rng: random.Random, base: Pose, desk: Desk, acceleration: tuple[float, float] | None
    ) -> None:
        super().__init__(base, acceleration)
        self._rng = rng
        self._desk = desk

    def execute(self, text: str, now_s: float) -> Answer:
        """Executes one received string; nothing while the program stands still."""
        self._desk.next(Channel.ARM)
        kinds = {fault.kind for fault in self._desk.holding(Channel.ARM)}
        if "arm_silent" in kinds:
            self.halted = "program stopped"
        elif "arm_unreachable" in kinds:
            self.halted = "50050 position outside reach"
        if self.halted:
            return Answer(None, math.inf)
        if "arm_refuses" in kinds:
            return Answer(f"{text.split(' ', 1)[0].lstrip('0') or '0'} 0 ", now_s)
        answer = super().execute(text, now_s)
        self._displace_hand(answer.ready_s)
        if "arm_disconnect" in kinds:
            return answer._replace(broken=True)
        return answer._replace(before=STALE) if "arm_stale_ack" in kinds else answer

    def _displace_hand(self, moment_s: float) -> None:
        """Displaces the hand, as a bump does: the controller knows its pose, but did not command it."""
        for fault in self._desk.beginning(Channel.ARM):
            if fault.kind == "arm_displaced":
                bearing = self._rng.uniform(-math.pi, math.pi)
                aside = (fault.value * math.cos(bearing), fault.value * math.sin(bearing))
                self.displace((*aside, 0.0, 0.0), moment_s)
            elif fault.kind == "arm_turned":
                turn_rad = math.copysign(math.radians(fault.value), self._rng.uniform(-1.0, 1.0))
                self.displace((0.0, 0.0, 0.0, turn_rad), moment_s)


class Failing(Fingers):
    """Mixin for a gripper's model: it fails; each request that it receives is one event of a desk.

    Args:
        rng: see the model.
        surroundings: what the fingers may meet.
        profile: of its model.
        desk: gives the current faults.
    """

    def __init__(
        self, rng: random.Random, surroundings: Surroundings, profile: Any, desk: Desk
    ) -> None:
        super().__init__(rng, surroundings, profile)
        self._desk = desk
        self._last: int | None = None  # last position read, for a frozen reading

    def _report(self, code: int, now_s: float) -> None:
        """Starts the counterpart of a Robotiq gripper's fault."""

    def _next_event(self, now_s: float) -> list[Fault]:
        """Counts one more request: a fault takes effect before the request."""
        self._desk.next(Channel.GRIPPER)
        for fault in self._desk.beginning(Channel.GRIPPER):
            if fault.kind == "power_cycle":
                self.power_cycle(now_s)
            elif fault.kind == "grip_lost":
                self.lose_object(now_s)
            elif code := _code(fault):
                self._report(code, now_s)
        faults = self._desk.holding(Channel.GRIPPER)
        self.delay_s = sum(fault.value for fault in faults if fault.kind == "flag_late")
        return faults

    def _misread(self, position: int, faults: list[Fault], most: int = MOST_COUNT) -> int:
        """A position, 0 to `most`, as faults misreport it; their values are in 255ths of the stroke."""
        values = {fault.kind: round(fault.value * most / MOST_COUNT) for fault in faults}
        if "count_frozen" not in values or self._last is None:
            self._last = position
        position = self._last + values.get("encoder_offset", 0)
        return min(max(values.get("count_spike", position), 0), most)


def _code(fault: Fault) -> int:
    """The gFLT code in a fault's name; 0 without one."""
    return int(fault.kind.removeprefix("gflt_"), 16) if fault.kind.startswith("gflt_") else 0


def _state(faults: list[Fault], *, moving: bool) -> int | None:
    """The reported object state in terms of gOBJ; None: the true one."""
    for fault in faults:
        if fault.kind == "flag_stuck" or (fault.kind == "flag_false" and moving):
            return int(fault.value) & 3
    return None


class FaultyGripper(Failing, GripperModel):
    """A Robotiq gripper that fails."""

    def _fields(self, now_s: float) -> dict[str, int]:
        """The fields of the input block, with their faults."""
        faults = self._next_event(now_s)
        fields = super()._fields(now_s)
        moving = bool(fields["gGTO"]) and fields["gOBJ"] == OBJ_MOVING
        if (state := _state(faults, moving=moving)) is not None:
            fields["gOBJ"] = state
        fields["gPO"] = self._misread(fields["gPO"], faults)
        for fault in faults:
            if 0 < _code(fault) < LEAST_MAJOR:
                fields["gFLT"] = _code(fault)
        return fields

    def write_output(self, offset: int, data: bytes, now_s: float) -> None:
        """Writes and obeys."""
        self._next_event(now_s)
        super().write_output(offset, data, now_s)

    def _report(self, code: int, now_s: float) -> None:
        if code == RELEASING:
            self.auto_release(now_s)
        elif code >= LEAST_MAJOR:
            self.fail(code, now_s)


class FaultyDhModel(Failing, DhModel):
    """A DH gripper that fails; it has no fault register, so gFLT faults do not apply."""

    def heard(self, now_s: float) -> None:
        """Counts one more event."""
        self._next_event(now_s)

    def read(self, address: int, now_s: float) -> int:
        """One register, with its faults."""
        word, faults = super().read(address, now_s), self._desk.holding(Channel.GRIPPER)
        if address == dh.GRIP:
            state = _state(faults, moving=word == Grip.MOVING)
            return word if state is None else state
        return self._misread(word, faults, dh.FULL) if address == dh.ACTUAL_POSITION else word


class FaultySchunkModel(Failing, SchunkModel):
    """A SCHUNK gripper that fails."""

    def read(self, name: str, now_s: float) -> bytes:
        """A parameter, with the faults of status and width."""
        faults = self._next_event(now_s)
        data = super().read(name, now_s)
        if name != "plc_sync_input":
            return data
        seen = Input.of(PARAMETERS[name].unpack(data))
        stroke_um = self.profile.stroke_um
        if (state := _state(faults, moving=not seen.status & OUTCOMES)) is not None:
            seen = seen._replace(status=seen.status & ~OUTCOMES | STATES[state])
        closed_um = self._misread(stroke_um - seen.position_um, faults, stroke_um)
        return PARAMETERS[name].pack(*seen._replace(position_um=stroke_um - closed_um))

    def write(self, name: str, data: bytes, now_s: float) -> None:
        """Writes and obeys."""
        self._next_event(now_s)
        super().write(name, data, now_s)

    def _report(self, code: int, now_s: float) -> None:
        if code == OVER_TEMPERATURE:
            self.fail(TOO_HOT, now_s)
        elif code >= LEAST_MAJOR:
            self.fail(SUPPLY, now_s)
