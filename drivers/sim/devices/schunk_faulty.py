"""A SCHUNK gripper that fails as a schedule has it."""

import random

from drivers.ports import GripperProfile
from drivers.schunk.registers import OUTCOMES, PARAMETERS, Status, decode
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.devices.schunk import SchunkModel
from drivers.sim.faults import Channel, Desk, Fault

SUPPLY = 0x74  # the error that stands for a major fault of a Robotiq gripper
LEAST_MAJOR = 0x0A
# Outcomes that stand for gOBJ 0 to 3.
FLAGS = (
    Status(0),
    Status.POSITION_REACHED | Status.SUCCESS,
    Status.GRIPPED | Status.SUCCESS,
    Status.NO_WORKPIECE,
)


class FaultySchunkModel(SchunkModel):
    """A SCHUNK gripper that fails; each request that it hears is one event of the desk.

    Args:
        rng: as of `SchunkModel`.
        surroundings: what the fingers may meet.
        profile: of its model.
        desk: says what holds when.
    """

    def __init__(
        self, rng: random.Random, surroundings: Surroundings, profile: GripperProfile, desk: Desk
    ) -> None:
        super().__init__(rng, surroundings, profile)
        self._desk = desk
        self._last_um = profile.stroke_um  # the width as it was last read, which is what freezes

    def read(self, name: str, now_s: float) -> bytes:
        """A parameter, with whatever is wrong with the status and the width."""
        faults = self._next_event(now_s)
        data = super().read(name, now_s)
        if name != "plc_sync_input":
            return data
        seen = decode(data)
        if not any(fault.kind == "count_frozen" for fault in faults):
            self._last_um = seen.position_um
        seen = seen._replace(position_um=self._last_um)
        for fault in faults:
            if fault.kind == "flag_stuck" or (
                fault.kind == "flag_false" and not seen.status & OUTCOMES
            ):
                seen = seen._replace(status=seen.status & ~OUTCOMES | FLAGS[int(fault.value)])
            elif fault.kind == "count_spike":
                seen = seen._replace(position_um=self._um(255 - fault.value))
            elif fault.kind == "encoder_offset":
                seen = seen._replace(position_um=seen.position_um - self._um(fault.value))
        return PARAMETERS[name].pack(*seen)

    def write(self, name: str, data: bytes, now_s: float) -> None:
        """Write and obey."""
        self._next_event(now_s)
        super().write(name, data, now_s)

    def _um(self, counts: float) -> int:
        """A length, where a schedule says 255ths of the stroke."""
        return round(counts * self.profile.stroke_um / 255)

    def _next_event(self, now_s: float) -> list[Fault]:
        """One more request: whatever befalls the gripper now, befalls it before it obeys."""
        self._desk.next(Channel.GRIPPER)
        for fault in self._desk.beginning(Channel.GRIPPER):
            if fault.kind == "power_cycle":
                self.power_cycle(now_s)
            elif fault.kind == "grip_lost":
                self.lose_object(now_s)
            elif fault.kind.startswith("gflt_") and fault.value >= LEAST_MAJOR:
                self.fail(SUPPLY, now_s)
        faults = self._desk.holding(Channel.GRIPPER)
        self.outcome_delay_s = sum(fault.value for fault in faults if fault.kind == "flag_late")
        return faults
