"""The checks that a reading passes before it is acted upon: fresh, possible, and self-consistent."""

from drivers.ports import Settled
from runtime.errors import GripperStateError
from runtime.table import UNDETECTED_UM, Calibration
from runtime.traversal.decision import ARRIVED, CLOSING_CONTACT, OPENING_CONTACT

CLOSED_COUNTS = 255
OPENED_COUNTS = 2
SET_UM = 1_000  # how far off jaws that push may stand


# Motor currents that a gripper at rest on a part may report: the 2F-85 manual's own example of a held object
# reads 0 mA, so a least one is a matter of calibration; more than 1 A is what the gripper calls overcurrent.
CURRENT_MA = (0, 1_000)


def check_fresh(settled: Settled, requested_counts: int) -> None:
    """Check that a settled reading belongs to the request.

    Raises:
        GripperStateError: it belongs to another request, is no encoder count, or is not settled.
    """
    if settled.echo_counts != requested_counts:
        raise GripperStateError(
            f"stale reading: the gripper answers request {settled.echo_counts}, asked was {requested_counts}"
        )
    if not 0 <= settled.position_counts <= CLOSED_COUNTS:
        raise GripperStateError(f"position {settled.position_counts} is no encoder count")
    if settled.object_flag not in (OPENING_CONTACT, CLOSING_CONTACT, ARRIVED):
        raise GripperStateError("the gripper reports a motion as finished and as going on")


def check_closed(settled: Settled, calibration: Calibration, current_ma: tuple[int, int]) -> None:
    """Check that a settled closing motion's flag and current agree with its width.

    Raises:
        GripperStateError: the flag tells of nothing where the fingers are apart, or of an opening motion; or
            the current is none a gripper at rest on a part draws.
    """
    width_um = calibration.width_um(settled.position_counts)
    if settled.object_flag == OPENING_CONTACT:
        raise GripperStateError("the gripper tells of contact while opening, asked was to close")
    if settled.object_flag == ARRIVED and width_um > UNDETECTED_UM:
        raise GripperStateError(
            f"the gripper reports that it closed on nothing and stands {width_um / 1000:.2f} mm open; "
            "one of the two is wrong"
        )
    least_ma, most_ma = current_ma
    if settled.object_flag != CLOSING_CONTACT:
        least_ma = 0
    if not least_ma <= settled.current_ma <= most_ma:
        raise GripperStateError(
            f"the motor draws {settled.current_ma} mA at rest, believed is {least_ma}..{most_ma} mA; "
            "look for a jammed finger, or state the band in the calibration file"
        )


def check_opened(settled: Settled, requested_counts: int, calibration: Calibration) -> None:
    """Check that the jaws opened as far as requested; the check for collisions of the descent counts on it.

    Raises:
        GripperStateError: the reading is stale, or the jaws are blocked.
    """
    check_fresh(settled, requested_counts)
    if not is_open(settled.position_counts, requested_counts, calibration):
        asked_um = calibration.width_um(requested_counts)
        stopped_um = calibration.width_um(settled.position_counts)
        raise GripperStateError(
            f"the jaws stopped at {stopped_um / 1000:.2f} mm while opening to {asked_um / 1000:.2f} mm; "
            "remove what blocks them"
        )


def is_open(position_counts: int, requested_counts: int, calibration: Calibration) -> bool:
    """Whether jaws at a count are open as far as requested."""
    least_um = calibration.width_um(min(requested_counts + OPENED_COUNTS, CLOSED_COUNTS))
    return calibration.width_um(position_counts) >= least_um


def check_set(position_counts: int, requested_counts: int, calibration: Calibration) -> None:
    """Check that the jaws stand, with nothing between them, about where they were set to push.

    Raises:
        GripperStateError: they do not.
    """
    stands_um, asked_um = (calibration.width_um(n) for n in (position_counts, requested_counts))
    if abs(stands_um - asked_um) > SET_UM:
        raise GripperStateError(
            f"the jaws stand at {stands_um / 1000:.2f} mm and were set to {asked_um / 1000:.2f} mm to push; "
            "look for what is between them or bends them"
        )


def check_passed(settled: Settled, requested_counts: int, calibration: Calibration) -> bool:
    """Check a closing motion to an intermediate width; whether it got there, or met something before.

    Raises:
        GripperStateError: the reading is stale, or the flag and the count contradict one another.
    """
    check_fresh(settled, requested_counts)
    if settled.object_flag == CLOSING_CONTACT:
        return False
    if (
        settled.object_flag == ARRIVED
        and abs(settled.position_counts - requested_counts) <= OPENED_COUNTS
    ):
        return True
    asked_um, seen_um = (
        calibration.width_um(n) for n in (requested_counts, settled.position_counts)
    )
    raise GripperStateError(
        f"the gripper reports flag {settled.object_flag} at {seen_um / 1000:.2f} mm while closing to "
        f"{asked_um / 1000:.2f} mm; the two do not fit"
    )


def reading_fields(reading: Settled) -> dict[str, object]:
    """A settled reading as a journal record holds it."""
    return {
        "object_flag": reading.object_flag,
        "echo_counts": reading.echo_counts,
        "current_ma": reading.current_ma,
        "settle_s": round(reading.seconds, 4),
    }
