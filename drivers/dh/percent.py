"""Converts widths to thousandths of the stroke, and speeds and forces to per cent; all linear."""

from drivers.dh.registers import FULL, LEAST_FORCE, LEAST_SPEED, MOST
from drivers.errors import PortError
from drivers.polling import setting
from drivers.ports import GripperProfile
from runtime.table import PROFILES

MODEL = "dh-ag95"  # default, since no register holds the model


class Scale:
    """Conversion between the units of a job and the settings of one gripper model.

    Raises:
        PortError: the model does not divide its stroke into thousandths.
    """

    def __init__(self, profile: GripperProfile | None) -> None:
        self.profile = profile or PROFILES[MODEL]
        if self.profile.steps != FULL:
            raise PortError(
                f"a {self.profile.model} of {self.profile.steps} steps is no gripper of DH-Robotics "
                f"({FULL}); check the port, or the gripper's model and resolution"
            )

    def position(self, width_um: int) -> int:
        """The position nearest to a width, in thousandths of the stroke."""
        return min(max(self.profile.step(width_um), 0), FULL)

    def speed(self, speed_mm_s: float) -> int:
        """The largest speed setting, per cent, that does not exceed a speed, or else the least setting."""
        return setting(speed_mm_s, self.profile.speed_mm_s, LEAST_SPEED, MOST)

    def speed_mm_s(self, percent: int) -> float:
        """Rate of the width, mm/s, at a speed setting."""
        least, most = self.profile.speed_mm_s
        return least + (most - least) * (percent - LEAST_SPEED) / (MOST - LEAST_SPEED)

    def force(self, force_n: float) -> int:
        """The largest force setting, per cent, that does not exceed a force, or else the least setting."""
        return setting(force_n, self.profile.force_n, LEAST_FORCE, MOST)
