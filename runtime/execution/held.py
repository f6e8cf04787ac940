"""What the fingers may hold when a run begins, and how to put it down.

Jaws that stopped before the width to which they were closing may hold something. The object flag says whether
they do, but not after a stop or a loss of power. Jaws at their requested width, wide open or closed, hold
nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from drivers.ports import GripperState, ObjectState
from runtime.errors import GripperStateError
from runtime.execution.delivery import Delivery, Places
from runtime.execution.hand import Hand
from runtime.execution.reading import room_um
from runtime.execution.safety import needs_activation
from runtime.journal.chain import Journal
from runtime.journal.lines import Entry
from runtime.journal.replay import UNDECIDED
from runtime.table import CLEAR_MM, Calibration, Table

# Jaws within `OPEN_UM` of their widest are open: some settle up to 3.7 mm short. Jaws less than `CLOSED_UM`
# apart hold nothing: every part is thicker.
OPEN_UM, CLOSED_UM = 4_000, 1_000


class Held(NamedTuple):
    """State of fingers that hold a part, or may hold one."""

    reading_um: int
    width_mm: float
    certain: bool  # the gripper reports contact
    active: bool  # the gripper is activated and reports no fault

    def sentence(self) -> str:
        """States at which width the fingers stand, whether they hold something, and how that is known."""
        if self.certain:
            known = "they met it while closing"
        elif self.active:
            known = "they were stopped on their way, at a part or not"
        else:
            known = "the gripper is not active and cannot tell what stopped them"
        stands = f"the fingers stand at {self.width_mm:.2f} mm and "
        return f"{stands}{'hold' if self.certain else 'may hold'} something: {known}"

    def refusal(self, arm_mm: float, journal: Journal | None) -> GripperStateError:
        """Builds the error that refuses a run; it states what is held, the arm's height and the remedy."""
        before = "" if journal is None else _last_end(journal.path, journal.last_part)
        remedy = "start with --put-down: straight down where the arm stands, open, retreat"
        if not self.active:
            remedy = "take it out before they sweep"
        return GripperStateError(
            f"{self.sentence()}; the arm stands {arm_mm:.1f} mm high{before}; {remedy}; "
            "or, if you see that there is nothing, start with --jaws-empty"
        )


def look(state: GripperState, calibration: Calibration) -> Held | None:
    """What the fingers of a gripper may hold, by its state at rest; None where they hold nothing."""
    width_um, short_um = calibration.width_um(state.width_um), state.width_um - state.target_um
    certain = state.activated and state.object is ObjectState.CLOSING and short_um >= 0
    is_open = width_um >= calibration.widest_um - OPEN_UM
    there = state.activated and abs(short_um) <= room_um(calibration.profile)
    opened = is_open and (short_um < 0 or not state.activated)
    if not certain and (there or opened or width_um <= CLOSED_UM):
        return None
    return Held(state.width_um, width_um / 1000, certain, not needs_activation(state))


def put_down(
    hand: Hand, table: Table, delivery: Places | None, journal: Journal
) -> Mapping[str, object]:
    """Lowers what the fingers hold straight down where the arm stands, releases it and retreats.

    If the arm stands outside the work area, it must stand in the area of the delivery. Areas of a `Sorting`
    do not count, since it is unknown which part the fingers hold.

    The place and the width are journalled before the motion and after it.

    Returns:
        The place and the width, as journalled.

    Raises:
        MotionRefusedError: the arm stands outside the work area and the area in which parts are carried.
        GripperStateError: the gripper is not ready, or the jaws do not open.
    """
    pose, reading_um = hand.where(), hand.gripper.state().width_um
    width_mm = hand.jaws.width_mm(reading_um)
    wide_um = min(round(1000 * (width_mm + CLEAR_MM)), table.gripper.opening_um)
    limits = hand.limits
    inside = limits.work_area_um.contains(pose[0], pose[1])
    # With several parts it is unknown which one they hold, and so in which area it was carried.
    if isinstance(delivery, Delivery) and delivery.area_um is not None and not inside:
        limits = replace(limits, work_area_um=delivery.area_um)
    width = {"reading_um": reading_um, "width_mm": round(width_mm, 3)}
    document = {"x_mm": pose[0], "y_mm": pose[1], **width}
    journal.record("put_down", {**document, "begun": True})
    with hand.limited(limits):
        hand.lower(pose[0], pose[1], pose[3], width_mm)
        hand.release(table.nodes[0].squeeze._replace(opening_um=wide_um))
        hand.retreat()
    journal.record("put_down", {**document, "begun": False})
    return document


def _last_end(path: Path, entries: Iterable[Entry]) -> str:
    """States how a journal's last part ended, if that may leave a part in the fingers; else ""."""
    last: Entry = {}
    for entry in entries:
        if entry["kind"] in ("header", "outcome", "put_down"):
            last = entry
    if last.get("outcome") not in UNDECIDED:
        return ""
    return f"; part {last['part']} of the last run in {path} ended as {last['outcome']}"
