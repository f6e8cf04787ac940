"""Grippers and finger materials to begin a job with: starting values, to be measured in the cell."""

from typing import NamedTuple

from runtime.table import PROFILES, Profile


class GripperPreset(NamedTuple):
    """A gripper as it comes; what its settings mean is in its profile."""

    profile: Profile
    finger_length_mm: float  # extent of a fingertip across the closing direction
    finger_width_mm: float  # along it
    speed_mm_s: float  # closing speed to begin with, moderate
    force_n: float  # grip force to begin with, low
    share_off: float = 0.11  # a finger may make so much more or less of the closing
    middle_off_mm: float = 1.4  # the fingers may meet so far off the hand's middle: 2 % of the way to a part
    encoder_off_mm: float = 1.1  # a width may read so much too much or too little: 3 counts

    @property
    def model(self) -> str:
        """Its name."""
        return self.profile.model

    @property
    def opening_mm(self) -> float:
        """Stroke."""
        return self.profile.opening_um / 1000

    @property
    def max_force_n(self) -> float:
        """What it can."""
        return self.profile.force_mn[1] / 1000

    @property
    def max_speed_mm_s(self) -> float:
        """What it can."""
        return self.profile.speed_um_s[1] / 1000


GRIPPERS = {
    preset.model: preset
    for preset in (
        GripperPreset(PROFILES["robotiq-2f-85"], 27.5, 9.5, 60.0, 40.0),
        GripperPreset(PROFILES["robotiq-2f-140"], 27.0, 13.5, 80.0, 40.0, 0.11, 2.4, 1.85),
        GripperPreset(PROFILES["hand-e"], 22.0, 10.0, 50.0, 40.0, 0.11, 0.8, 0.6),
    )
}


class Fingers(NamedTuple):
    """What the fingers are faced with: bounds on its dry friction against metals and plastics."""

    low: float
    high: float
    told: str


FINGERS = {
    "rubber": Fingers(0.5, 0.9, "rubber or polyurethane pads"),
    "silicone": Fingers(0.6, 1.0, "silicone pads"),
    "aluminium": Fingers(0.25, 0.5, "bare aluminium"),
    "steel": Fingers(0.15, 0.4, "bare steel"),
    "plastic": Fingers(0.2, 0.4, "nylon, POM or printed plastic"),
    "unknown": Fingers(0.2, 0.8, "nobody knows: a wide interval costs squeezes, not truth"),
}
