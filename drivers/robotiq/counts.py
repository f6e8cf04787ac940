"""Conversion between counts of the registers and widths, speeds and forces: linear over 0 to 255."""

from drivers.errors import PortError
from drivers.polling import setting
from drivers.ports import MOST_COUNT, GripperProfile
from runtime.table import PROFILES

OPEN, CLOSED = 0, MOST_COUNT  # requests beyond the ends of travel: as far as the fingers go
MODEL = "robotiq-2f-85"  # default, since no register holds the model


class Counts:
    """Conversion between the counts of one gripper model and widths, speeds and forces.

    Raises:
        PortError: the profile has no `counts`.
    """

    def __init__(self, profile: GripperProfile | None) -> None:
        self.profile = profile or PROFILES[MODEL]
        if self.profile.counts is None:
            raise PortError(
                f"a {self.profile.model} of {self.profile.steps} steps has no register of counts; check the "
                "port, or the gripper's model and resolution"
            )
        _, self._closed = self.profile.counts

    def width_um(self, count: int) -> int:
        """The nominal width at a position count, extrapolated beyond the end counts."""
        return self.profile.counted_um(count)

    def target_um(self, count: int) -> int:
        """The width that a requested count stands for: at most the stroke; -1 beyond the closed end."""
        return min(max(self.width_um(count), -1), self.profile.stroke_um)

    def request(self, width_um: int) -> int:
        """The count that requests a width: `CLOSED` for a negative width, `OPEN` for the stroke or more."""
        if width_um >= self.profile.stroke_um:
            return OPEN
        return CLOSED if width_um < 0 else self._closed - self.profile.step(width_um)

    def speed(self, speed_mm_s: float) -> int:
        """The largest speed setting that does not exceed a speed, or else the least setting."""
        return setting(speed_mm_s, self.profile.speed_mm_s, 0, CLOSED)

    def force(self, force_n: float) -> int:
        """The largest force setting that does not exceed a force, or else the least setting."""
        return setting(force_n, self.profile.force_n, 0, CLOSED)
