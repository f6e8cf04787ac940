"""An arm controller that fails as a schedule has it, in front of the model of a sound one."""

import math

from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.faults.schedule import Channel, Desk

STALE = "1 1 "  # the acknowledgement of a MoveL


class FaultyArm:
    """Executes instructions, as `drivers.sim.devices.arm.Controller`.

    Args:
        model: the controller.
        desk: says what holds when; each instruction is one event.
    """

    def __init__(self, model: ArmModel, desk: Desk) -> None:
        self._model = model
        self._desk = desk

    def execute(self, text: str, now_s: float) -> Answer:
        """One received string; nothing is executed while the program stands still."""
        self._desk.next(Channel.ARM)
        kinds = {fault.kind for fault in self._desk.holding(Channel.ARM)}
        if kinds & {"arm_silent", "arm_unreachable"}:
            silent = "arm_silent" in kinds
            self._model.halted = "program stopped" if silent else "50050 position outside reach"
        if self._model.halted:
            return Answer(None, math.inf)
        if "arm_refuses" in kinds:
            return Answer(f"{text.split(' ', 1)[0].lstrip('0') or '0'} 0 ", now_s)
        answer = self._model.execute(text, now_s)
        if "arm_disconnect" in kinds:
            return answer._replace(broken=True)
        return answer._replace(before=STALE) if "arm_stale_ack" in kinds else answer
