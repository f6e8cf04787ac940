"""Grippers and finger materials to begin a job with: starting values, to be measured in the cell.

The 2F-85's figures are those of the rest of the project; the others are near what the maker announces.
"""

from typing import NamedTuple


class GripperPreset(NamedTuple):
    """A gripper as it comes."""

    model: str  # its name
    finger_length_mm: float  # extent of a fingertip across the closing direction
    finger_width_mm: float  # along it
    opening_mm: float  # stroke
    count_open: int  # encoder reading, jaws open
    count_closed: int  # encoder reading, jaws closed on nothing
    speed_mm_s: float  # closing speed to begin with, moderate
    force_n: float  # grip force to begin with, low
    max_force_n: float  # what it can
    max_speed_mm_s: float  # what it can
    share_off: float = 0.11  # a finger may make so much more or less of the closing
    middle_off_mm: float = 1.4  # the fingers may meet so far off the hand's middle: 2 % of the way to a part
    encoder_off_mm: float = 1.1  # a width may read so much too much or too little: 3 counts


GRIPPERS = {
    preset.model: preset
    for preset in (
        GripperPreset("robotiq-2f-85", 27.5, 9.5, 85.0, 3, 230, 60.0, 40.0, 235.0, 150.0),
        GripperPreset("robotiq-2f-140", 27.0, 13.5, 140.0, 3, 230, 80.0, 40.0, 125.0, 250.0, 0.11, 2.4, 1.85),
        GripperPreset("hand-e", 22.0, 10.0, 50.0, 0, 255, 50.0, 40.0, 185.0, 150.0, 0.11, 0.8, 0.6),
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
