"""Parts of the simulated gripper: mechanics, strokes, the lagging object flag, what fingers may meet."""

from typing import NamedTuple, Self

from drivers.ports import GripperProfile
from drivers.robotiq.registers import OBJ_MOVING
from runtime.shell.errors import UsageError


class Jaws(NamedTuple):
    """The mechanics: opening between the end stops, linear in counts."""

    opening_mm: float = 85.0
    count_open: int = 3
    count_closed: int = 230

    @classmethod
    def of(cls, profile: GripperProfile) -> Self:
        """Those of a gripper that counts.

        Raises:
            UsageError: its readings are no counts.
        """
        if profile.counts is None:
            raise UsageError(f"there is no simulated gripper {profile.model}")
        return cls(profile.stroke_um / 1000.0, *profile.counts)

    @property
    def counts_per_mm(self) -> float:
        """Encoder counts per mm of opening."""
        return (self.count_closed - self.count_open) / self.opening_mm

    def opening_at(self, counts: float) -> float:
        """Distance of the fingers in mm at a count."""
        return (self.count_closed - counts) / self.counts_per_mm

    def count_at(self, opening_mm: float) -> int:
        """Encoder count at an opening, clamped to the end stops."""
        count = round(self.count_closed - opening_mm * self.counts_per_mm)
        return min(max(count, self.count_open), self.count_closed)


class Surroundings:
    """What the fingers may meet; here nothing."""

    def closing(self) -> float | None:
        """The jaws start to close: the width [mm] at which something will stop them, or None."""
        return None

    def gripped(self) -> None:
        """They were stopped by it now."""

    def released(self) -> None:
        """They open again and let go of it."""


class Stroke(NamedTuple):
    """A straight motion in counts and seconds; `rate` is signed, `outcome` the gOBJ at its end."""

    start: float
    start_s: float
    rate: float
    stop: float
    outcome: int

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.start_s + (abs((self.stop - self.start) / self.rate) if self.rate else 0.0)

    def at(self, now_s: float) -> float:
        """Position in counts."""
        return self.stop if now_s >= self.end_s else self.start + self.rate * (now_s - self.start_s)


class ObjectFlag(NamedTuple):
    """gOBJ over one move: the old value, 0 while moving, the outcome; each change comes late."""

    old: int
    moving_s: float
    outcome: int
    outcome_s: float

    def at(self, now_s: float) -> int:
        """The flag as the register shows it."""
        if now_s >= self.outcome_s:
            return self.outcome
        return OBJ_MOVING if now_s >= self.moving_s else self.old
