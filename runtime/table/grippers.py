"""Profiles of known grippers, by the model that a job names; no other file has such presets.

The values are published ones; none was measured for this project. A calibration with gauge blocks
(`grasp-calibrate width`) corrects widths, not speed and force. A driver of another make provides the profile
of its gripper as an entry point of the group `squeezetree.profiles` (tools/docs/drivers.md).
"""

import re
from contextlib import suppress

from drivers.ports import GripperProfile
from runtime.errors import TableError

GROUP = "squeezetree.profiles"
DOUBT_STEPS = 3  # doubt about widths, in units of the larger of resolution and noise


PROFILES = {
    profile.model: profile
    for profile in (
        # Robotiq's SDK, device_profile.hpp: counts read on a bench. The arc comes from its URDF models.
        # Teleoperation streams positions to it while it moves. Up to 5 mm its object detection may miss a
        # part (2F-85 manual, "object detection").
        GripperProfile(
            model="robotiq-2f-85",
            stroke_um=85_000,
            resolution_um=85_000 / 227,
            noise_um=150,
            speed_mm_s=(20.0, 150.0),
            force_n=(20.0, 235.0),
            streams=True,
            arc_mm=(57.15, 5.0),
            fingers_mm=(27.5, 9.5),
            radius_mm=80.0,
            counts=(3, 230),
        ),
        # Commonly published figures, not compared with a manual's page; a user read 230 closed on nothing
        # (ur_rtde issue 356). The URDF models agree on the link and differ by 5 mm in where the pads are.
        GripperProfile(
            model="robotiq-2f-140",
            stroke_um=140_000,
            resolution_um=140_000 / 227,
            noise_um=150,
            speed_mm_s=(30.0, 250.0),
            force_n=(10.0, 125.0),
            arc_mm=(100.0,),
            fingers_mm=(27.0, 13.5),
            radius_mm=120.0,
            counts=(3, 230),
        ),
        # Commonly published figures, not compared with a manual's page; early units have 60 to 130
        # N. The ends of the register are the encoder's ends.
        GripperProfile(
            model="hand-e",
            stroke_um=50_000,
            resolution_um=50_000 / 255,
            noise_um=150,
            speed_mm_s=(20.0, 150.0),
            force_n=(20.0, 185.0),
            fingers_mm=(22.0, 10.0),
            radius_mm=70.0,
            counts=(0, 255),
        ),
        # Data sheets of DH-Robotics' AG-95 and PGC-140-50: stroke, opening and closing time 0.7 s, force,
        # repeatability +-0.03 mm; settings of 1 and 20 to 100 % and positions of thousandths by the short
        # manuals, 2.3.4.2 to 2.3.4.4. The arc of an AG-95 comes from one public URDF model.
        GripperProfile(
            model="dh-ag95",
            stroke_um=95_000,
            resolution_um=95.0,
            noise_um=30,
            speed_mm_s=(1.357, 135.7),
            force_n=(45.0, 160.0),
            arc_mm=(55.0,),
        ),
        GripperProfile(
            model="dh-pgc140-50",
            stroke_um=50_000,
            resolution_um=50.0,
            noise_um=30,
            speed_mm_s=(0.714, 71.4),
            force_n=(40.0, 140.0),
        ),
        # An EGU 60 and an EGK 25 of SCHUNK, by their parameters (drivers/schunk/README.md):
        # min_vel, max_vel, min_grp_force, max_grp_force, max_grp_vel. They read whole um; the noise is
        # a guess.
        GripperProfile(
            model="schunk-egu",
            stroke_um=120_000,
            resolution_um=10.0,
            noise_um=20,
            speed_mm_s=(10.0, 110.0),
            force_n=(325.0, 650.0),
            grip_mm_s=25.0,
        ),
        GripperProfile(
            model="schunk-egk",
            stroke_um=53_000,
            resolution_um=10.0,
            noise_um=20,
            speed_mm_s=(5.0, 120.0),
            force_n=(25.0, 50.0),
            grip_mm_s=20.0,
        ),
    )
}
DEFAULT_MODEL = next(iter(PROFILES))  # where nobody names one
# Aliases of the same models, in lower case, with dashes and without "robotiq-".
NAMES = {"2f-85": "robotiq-2f-85", "c-85": "robotiq-2f-85", "2f-140": "robotiq-2f-140"}


def profile_of(model: str) -> GripperProfile:
    """The profile of a model by its name, ignoring case, spaces and dashes.

    Raises:
        TableError: the model is unknown, or its driver's profile is invalid.
    """
    profile = known(model)
    if profile is None:
        raise TableError(
            f"gripper {model[:40]!r} is not known; there are {', '.join(PROFILES)}: name one of them, or "
            "install the driver that brings its profile (tools/docs/drivers.md)"
        )
    return profile


def known(model: str) -> GripperProfile | None:
    """The profile of a model by its name, like `profile_of`; None for an unknown model.

    Raises:
        TableError: the profile of the model's driver is invalid.
    """
    name = _normalised(model)
    preset = next((one for key, one in PROFILES.items() if name == _normalised(key)), None)
    return preset or _plugged_in(model, name)


def selectable() -> dict[str, GripperProfile]:
    """The presets, then the profiles of installed drivers, by model; invalid profiles are left out."""
    from importlib.metadata import entry_points

    result = dict(PROFILES)
    for name in sorted({point.name for point in entry_points(group=GROUP)}):
        with suppress(TableError):
            result.setdefault(name, profile_of(name))
    return result


def doubt_um(resolution_um: float, noise_um: float) -> float:
    """Assumed largest error of a gripper's widths, um: three times the larger of resolution and noise."""
    return DOUBT_STEPS * max(resolution_um, noise_um)


def _plugged_in(model: str, name: str) -> GripperProfile | None:
    """The profile that an installed driver brings for a model; None where no driver does.

    Args:
        model: the model's name, for messages.
        name: the same name in the spelling of `_normalised`.

    Raises:
        TableError: the profile cannot be loaded, or is invalid.
    """
    from importlib.metadata import entry_points  # only for models that this file lacks

    points = [point for point in entry_points(group=GROUP) if _normalised(point.name) == name]
    if not points:
        return None
    try:
        (profile,) = {point.load() for point in points}
    except Exception as error:
        raise TableError(f"the profile of gripper {model!r} cannot be loaded: {error}") from error
    if not isinstance(profile, GripperProfile) or not _is_sound(profile):
        raise TableError(f"the profile of gripper {model!r} is not understood: {profile!r:.200}")
    return profile


def _is_sound(profile: GripperProfile) -> bool:
    """Whether the numbers of a profile are possible for a gripper."""
    pairs = (profile.speed_mm_s, profile.force_n)
    numbers = [profile.stroke_um, profile.resolution_um, profile.noise_um, *pairs[0], *pairs[1]]
    if not all(isinstance(number, int | float) and number >= 0 for number in numbers):
        return False
    rising = all(low < high for low, high in pairs)
    sound = rising and 0 < profile.resolution_um <= profile.stroke_um
    sizes = [profile.radius_mm, *([] if profile.grip_mm_s is None else [profile.grip_mm_s])]
    sound = sound and all(isinstance(size, int | float) and size > 0.0 for size in sizes)
    return sound and len(profile.arc_mm) <= 2 and isinstance(profile.streams, bool)


def same_model(one: str, other: str) -> bool:
    """Whether two names mean the same model, ignoring case, spaces and dashes."""
    return _normalised(one) == _normalised(other)


def _normalised(model: str) -> str:
    """One spelling for all names of a model: in lower case, with dashes, without "robotiq-" in front."""
    name = "-".join(re.split(r"[\s_-]+", model.strip().casefold())).removeprefix("robotiq-")
    return NAMES.get(name, name)
