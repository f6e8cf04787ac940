"""An arm controller that fails by a schedule."""

import math
import random

from drivers.abb.codec import Pose
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.faults import Channel, Desk

STALE = "1 1 "  # the acknowledgement of a MoveL


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
