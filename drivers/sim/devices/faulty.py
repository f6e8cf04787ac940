"""Gripper and arm controller that fail as a schedule has it."""

import math
import random

from drivers.abb.codec import Pose
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.jaws import Jaws, Surroundings
from drivers.sim.faults import Channel, Desk, Fault

STALE = "1 1 "  # the acknowledgement of a MoveL
FLAG_BYTE, FLAG_SHIFT, FAULT_BYTE, COUNT_BYTE = 0, 6, 2, 4
GOING, MOVING = 0x08, 0
RELEASING = 0x0B
LEAST_MAJOR = 0x0A  # these the model itself has from then on; lesser ones only show


class FaultyArm(ArmModel):
    """A controller that fails as the desk says; each instruction is one event of it.

    Args:
        rng: draws where to a hand is displaced.
        base: as of `ArmModel`.
        desk: says what holds when.
        acceleration: as of `ArmModel`.
    """

    def __init__(
        self,
        rng: random.Random,
        base: Pose,
        desk: Desk,
        acceleration: tuple[float, float] | None = None,
    ) -> None:
        super().__init__(base, acceleration)
        self._rng = rng
        self._desk = desk

    def execute(self, text: str, now_s: float) -> Answer:
        """One received string; nothing is executed while the program stands still."""
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
        """A bump or a slipped joint: what the controller knows of, but was not asked for."""
        for fault in self._desk.beginning(Channel.ARM):
            if fault.kind == "arm_displaced":
                bearing = self._rng.uniform(-math.pi, math.pi)
                aside = (fault.value * math.cos(bearing), fault.value * math.sin(bearing))
                self.displace((*aside, 0.0, 0.0), moment_s)
            elif fault.kind == "arm_turned":
                turn_rad = math.copysign(math.radians(fault.value), self._rng.uniform(-1.0, 1.0))
                self.displace((0.0, 0.0, 0.0, turn_rad), moment_s)


class FaultyGripper(GripperModel):
    """A gripper that fails; each request that it hears is one event of the desk.

    Args:
        rng: as of `GripperModel`.
        jaws: the mechanics.
        surroundings: what the fingers may meet.
        desk: says what holds when.
    """

    def __init__(
        self, rng: random.Random, jaws: Jaws, surroundings: Surroundings, desk: Desk
    ) -> None:
        super().__init__(rng, jaws, surroundings)
        self._desk = desk
        self._last_count = jaws.count_open  # the count as it was last read, which is what freezes

    def read_input(self, now_s: float) -> bytes:
        """The 16 input bytes, with whatever is wrong with them."""
        faults = self._next_event(now_s)
        block = bytearray(super().read_input(now_s))
        if not any(fault.kind == "count_frozen" for fault in faults):
            self._last_count = block[COUNT_BYTE]
        for fault in faults:
            self._distort(block, fault)
        return bytes(block)

    def write_output(self, offset: int, data: bytes, now_s: float) -> None:
        """Write and obey."""
        self._next_event(now_s)
        super().write_output(offset, data, now_s)

    def _next_event(self, now_s: float) -> list[Fault]:
        """One more request: whatever befalls the gripper now, befalls it before it obeys."""
        self._desk.next(Channel.GRIPPER)
        for fault in self._desk.beginning(Channel.GRIPPER):
            code = _code(fault)
            if fault.kind == "power_cycle":
                self.power_cycle(now_s)
            elif fault.kind == "grip_lost":
                self.lose_object(now_s)
            elif code == RELEASING:
                self.auto_release(now_s)
            elif code >= LEAST_MAJOR:
                self.fail(code, now_s)
        faults = self._desk.holding(Channel.GRIPPER)
        self.flag_delay_s = sum(fault.value for fault in faults if fault.kind == "flag_late")
        return faults

    def _distort(self, block: bytearray, fault: Fault) -> None:
        value = int(fault.value)
        moving = block[FLAG_BYTE] >> FLAG_SHIFT == MOVING and block[FLAG_BYTE] & GOING
        if fault.kind == "flag_stuck" or (fault.kind == "flag_false" and moving):
            block[FLAG_BYTE] = block[FLAG_BYTE] & ~(3 << FLAG_SHIFT) | (value & 3) << FLAG_SHIFT
        elif fault.kind == "count_frozen":
            block[COUNT_BYTE] = self._last_count
        elif fault.kind == "count_spike":
            block[COUNT_BYTE] = value & 0xFF
        elif fault.kind == "encoder_offset":
            block[COUNT_BYTE] = min(max(block[COUNT_BYTE] + value, 0), 255)
        elif 0 < _code(fault) < LEAST_MAJOR:
            block[FAULT_BYTE] = _code(fault)


def _code(fault: Fault) -> int:
    """The gFLT code that a fault is named after; 0: it is none of these."""
    return int(fault.kind.removeprefix("gflt_"), 16) if fault.kind.startswith("gflt_") else 0
