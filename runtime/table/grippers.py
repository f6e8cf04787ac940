"""What a gripper's settings of 0 to 255 mean, by the model that a table names.

A calibration with gauge blocks (`grasp-calibrate width`) takes the place of the encoder's ends; speed and
force are nominal. Nothing here was measured on a gripper of our own. A driver of another make brings the
profile of its gripper as an entry point of the group `squeezetree.profiles` (tools/docs/drivers.md).
"""

import re
from math import hypot
from typing import NamedTuple

from runtime.errors import TableError
from runtime.table.model import GripperSpec

GROUP = "squeezetree.profiles"


class Profile(NamedTuple):
    """One model; speed and force are linear over 0..255."""

    model: str  # as a job names it
    opening_um: int  # stroke
    count_open: int  # encoder, asked to open fully
    count_closed: int  # encoder, closed on nothing
    speed_um_s: tuple[int, int]  # rate of the opening, slowest and fastest
    force_mn: tuple[int, int]  # nominal grip force, weakest and strongest
    # link and offset of the arc that the tips move on, mm; a link alone: the offset has to be measured;
    # empty: they move straight
    arc_mm: tuple[float, ...]
    redirects: bool = (
        False  # whether it takes another position, speed and force while the jaws move
    )
    radius_mm: float = (
        160.0  # how far it reaches from its axis, jaws open, its maker's fingers included
    )

    def speed_counts(self, speed_um_s: int) -> int:
        """The fastest speed setting that is not faster than asked, 0..255."""
        return _setting(speed_um_s, *self.speed_um_s)

    def force_counts(self, force_mn: int) -> int:
        """The strongest force setting that is not stronger than asked, 0..255."""
        return _setting(force_mn, *self.force_mn)

    @property
    def spec(self) -> GripperSpec:
        """A gripper of a table, but for its fingers."""
        return GripperSpec(self.model, self.opening_um, 1, 1, self.count_open, self.count_closed, 0)


PROFILES = {
    profile.model: profile
    for profile in (
        # Robotiq's SDK, device_profile.hpp: counts read on a bench. The arc is that of its URDF models.
        # Teleoperation streams positions to it while it moves.
        Profile(
            "robotiq-2f-85",
            85_000,
            3,
            230,
            (20_000, 150_000),
            (20_000, 235_000),
            (57.15, 5.0),
            redirects=True,
            radius_mm=80.0,
        ),
        # Commonly published figures, not compared with a manual's page; a user read 230 closed on nothing
        # (ur_rtde issue 356). The URDF models agree on the link and differ by 5 mm in where the pads are.
        Profile(
            "robotiq-2f-140",
            140_000,
            3,
            230,
            (30_000, 250_000),
            (10_000, 125_000),
            (100.0,),
            radius_mm=120.0,
        ),
        # Commonly published figures, not compared with a manual's page; early units have 60 to 130 N. The
        # encoder's ends are those of the register.
        Profile("hand-e", 50_000, 0, 255, (20_000, 150_000), (20_000, 185_000), (), radius_mm=70.0),
    )
}
# Further names of the same models, as `_normalised`.
NAMES = {
    "2f-85": "robotiq-2f-85",
    "c-85": "robotiq-2f-85",
    "2f-140": "robotiq-2f-140",
    "hand-e": "hand-e",
}


def profile_of(model: str) -> Profile:
    """The profile of a model as a table names it: its name, whatever its case, spaces and dashes.

    Raises:
        TableError: no such model is known; its settings would be guessed.
    """
    name = _normalised(model)
    if name in NAMES:
        return PROFILES[NAMES[name]]
    return _plugged_in(model, name)


def turn_radius_mm(gripper: GripperSpec) -> float:
    """How far an open gripper with a table's fingers reaches from its axis.

    Raises:
        TableError: the model is not known.
    """
    aside_um = gripper.opening_um / 2 + gripper.finger_width_um
    fingers_mm = hypot(aside_um, gripper.finger_length_um / 2) / 1e3
    return max(profile_of(gripper.model).radius_mm, fingers_mm)


def _plugged_in(model: str, name: str) -> Profile:
    from importlib.metadata import entry_points  # only for a model that is none of ours

    points = [point for point in entry_points(group=GROUP) if _normalised(point.name) == name]
    if not points:
        raise TableError(
            f"the table is for a gripper {model[:40]!r}, which is not known; there are "
            f"{', '.join(PROFILES)}: correct gripper.model in the job and compile it again, or install the "
            "driver that brings the gripper's profile (tools/docs/drivers.md)"
        )
    try:
        (profile,) = {point.load() for point in points}
    except Exception as error:
        raise TableError(f"the profile of gripper {model!r} cannot be loaded: {error}") from error
    if not isinstance(profile, Profile) or not _is_sound(profile):
        raise TableError(f"the profile of gripper {model!r} is not understood: {profile!r:.200}")
    return profile


def _is_sound(profile: Profile) -> bool:
    """Whether its numbers can be those of a gripper."""
    rising = (profile.speed_um_s, profile.force_mn, (profile.count_open, profile.count_closed))
    numbers = [profile.opening_um, *(number for pair in rising for number in pair)]
    if not all(isinstance(number, int) and number >= 0 for number in numbers):
        return False
    sound = profile.opening_um > 0 and all(low < high for low, high in rising)
    sound = sound and isinstance(profile.radius_mm, int | float) and profile.radius_mm > 0.0
    return sound and len(profile.arc_mm) <= 2 and isinstance(profile.redirects, bool)


def same_model(one: str, other: str) -> bool:
    """Whether two names are of one model, whatever their case, spaces and dashes."""
    one, other = _normalised(one), _normalised(other)
    return NAMES.get(one, one) == NAMES.get(other, other)


def _normalised(model: str) -> str:
    return "-".join(re.split(r"[\s_-]+", model.strip().casefold())).removeprefix("robotiq-")


def _setting(value: int, least: int, most: int) -> int:
    return min(max((value - least) * 255 // (most - least), 0), 255)
