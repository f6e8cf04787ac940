"""The checks that a reading passes before it is acted upon: fresh, possible, and self-consistent."""

from math import ceil

from drivers.ports import GripperProfile, ObjectState, Settled
from runtime.errors import GripperStateError
from runtime.table import Calibration

CLOSED_UM = -1  # request on which the jaws close as far as they go
STANDS_UM = 750  # tolerated distance of the jaws from their request
STANDS_STEPS = 2  # the same distance in steps of the gripper's resolution
SET_UM = 1_000  # tolerated error of jaws that push


# Motor currents of a gripper at rest on a part: the 2F-85 manual's example of a held object reads 0
# mA, so a lower limit needs calibration; more than 1 A is what the gripper calls overcurrent.
CURRENT_MA = (0, 1_000)


def room_um(profile: GripperProfile) -> int:
    """Tolerated distance, um, of jaws at rest from the width that was requested."""
    return max(STANDS_UM, ceil(STANDS_STEPS * profile.resolution_um))


def check_fresh(settled: Settled, requested_um: int) -> None:
    """Checks that a settled reading belongs to the request.

    Raises:
        GripperStateError: the reading belongs to another request, or is not settled.
    """
    seen_um, asked_um = (max(target, 0) for target in (settled.target_um, requested_um))
    if seen_um != asked_um:
        raise GripperStateError(
            f"stale reading: the gripper answers a request for {seen_um / 1000:.2f} mm, requested were "
            f"{asked_um / 1000:.2f} mm"
        )
    if settled.object is ObjectState.NONE:
        raise GripperStateError("the gripper reports a motion as finished and as going on")


def check_closed(settled: Settled, calibration: Calibration, current_ma: tuple[int, int]) -> None:
    """Checks the reading of a settled closing motion: flag and width agree, and the current is plausible.

    Raises:
        GripperStateError: the flag reports that nothing was met although the fingers are apart, or reports an
            opening motion; or the current is impossible for a gripper at rest.
    """
    width_um = calibration.width_um(settled.width_um)
    if settled.object is ObjectState.OPENING:
        raise GripperStateError("the gripper reports contact while opening, but was asked to close")
    if settled.object is ObjectState.AT_TARGET and width_um > calibration.profile.empty_um:
        raise GripperStateError(
            f"the gripper reports that it closed on nothing and stands {width_um / 1000:.2f} mm open; "
            "one of the two is wrong"
        )
    least_ma, most_ma = current_ma
    if settled.object is not ObjectState.CLOSING:
        least_ma = 0
    if not least_ma <= settled.current_ma <= most_ma:
        raise GripperStateError(
            f"the motor draws {settled.current_ma} mA at rest, plausible are {least_ma}..{most_ma} mA; "
            "look for a jammed finger, or state the band in the calibration file"
        )


def check_opened(settled: Settled, requested_um: int, calibration: Calibration) -> None:
    """Checks that the jaws are open as requested, before the hand comes down beside the part.

    Raises:
        GripperStateError: the reading is stale; or the jaws are blocked, or met something while closing to a
            smaller opening.
    """
    check_fresh(settled, requested_um)
    asked_um, stopped_um = map(calibration.width_um, (requested_um, settled.width_um))
    if settled.object is ObjectState.CLOSING:
        raise GripperStateError(
            f"the jaws met something at {stopped_um / 1000:.2f} mm on their way to {asked_um / 1000:.2f} mm, "
            "above the part; look for what is between them"
        )
    if not is_open(settled.width_um, requested_um, calibration):
        raise GripperStateError(
            f"the jaws stopped at {stopped_um / 1000:.2f} mm while opening to {asked_um / 1000:.2f} mm; "
            "remove what blocks them"
        )


def is_open(reading_um: int, requested_um: int, calibration: Calibration) -> bool:
    """Whether jaws at a reading are open as far as requested."""
    least_um = calibration.width_um(requested_um - room_um(calibration.profile))
    return calibration.width_um(reading_um) >= least_um


def check_set(reading_um: int, requested_um: int, calibration: Calibration) -> None:
    """Checks that the jaws stand about where they were set for a push, with nothing between them.

    Raises:
        GripperStateError: the jaws stand more than `SET_UM` off.
    """
    stands_um, asked_um = map(calibration.width_um, (reading_um, requested_um))
    if abs(stands_um - asked_um) > SET_UM:
        raise GripperStateError(
            f"the jaws stand at {stands_um / 1000:.2f} mm and were set to {asked_um / 1000:.2f} mm to push; "
            "look for what is between them or bends them"
        )


def check_passed(settled: Settled, requested_um: int, calibration: Calibration) -> bool:
    """Checks a closing motion to an intermediate width; returns False if the jaws met something on the way.

    Raises:
        GripperStateError: the reading is stale, or object state and width contradict one another.
    """
    check_fresh(settled, requested_um)
    if settled.object is ObjectState.CLOSING:
        return False
    stands = abs(settled.width_um - requested_um) <= room_um(calibration.profile)
    if settled.object is ObjectState.AT_TARGET and stands:
        return True
    asked_um, seen_um = map(calibration.width_um, (requested_um, settled.width_um))
    raise GripperStateError(
        f"the gripper reports {settled.object.sentence} at {seen_um / 1000:.2f} mm while closing to "
        f"{asked_um / 1000:.2f} mm; the two do not fit"
    )


def reading_fields(reading: Settled) -> dict[str, object]:
    """The fields of a settled reading in a journal record."""
    return {
        "object_flag": int(reading.object),
        "target_um": reading.target_um,
        "current_ma": reading.current_ma,
        "settle_s": round(reading.seconds, 4),
    }
