"""What the fingers may hold when a run begins, and how it is put down.

The gripper alone tells: a request to close, echoed, and jaws that stand short of it. That they met something
its flag says; of jaws that a stop halted before they had, and of a gripper that lost its power, nobody knows.
Jaws that stand where they were sent, wide open, or closed on nothing hold nothing.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from drivers.ports import GripperState, PoseOfHand
from runtime.devices.ports import Journal
from runtime.errors import GripperStateError
from runtime.execution.delivery import Delivery
from runtime.execution.hand import CLEAR_MM, Hand
from runtime.execution.reading import OPENED_COUNTS
from runtime.journal.chain import records
from runtime.journal.replay import UNDECIDED
from runtime.table import Calibration, Table
from runtime.traversal.decision import CLOSING_CONTACT

# Jaws within this of their widest are open: they settle at counts 3 to 13 (Robotiq SDK); the thinnest part.
OPEN_UM, CLOSED_UM = 4_000, 1_000


class Held(NamedTuple):
    """What the fingers hold, or may hold.

    Attributes:
        position_counts: where they stand.
        width_mm: the opening that means.
        certain: whether the gripper tells of contact.
        active: whether the gripper is activated.
    """

    position_counts: int
    width_mm: float
    certain: bool
    active: bool

    def sentence(self) -> str:
        """What is known of it, and what is not."""
        if self.certain:
            known = "they met it while closing"
        elif self.active:
            known = "they were stopped on their way, at a part or not"
        else:
            known = "the gripper is not active and cannot tell what stopped them"
        stands = f"the fingers stand at count {self.position_counts} ({self.width_mm:.2f} mm) and "
        return f"{stands}{'hold' if self.certain else 'may hold'} something: {known}"

    def refusal(self, arm_mm: float, journal: Path) -> GripperStateError:
        """Why a run does not begin, and what to do.

        Args:
            arm_mm: height of the arm.
            journal: of the run; what its last run ended with is told.
        """
        remedy = "start with --put-down: straight down where the arm stands, open, retreat"
        if not self.active:
            remedy = "take it out before they sweep"
        return GripperStateError(
            f"{self.sentence()}; the arm stands {arm_mm:.1f} mm high{_last_end(journal)}; {remedy}; "
            "or, if you see that there is nothing, start with --jaws-empty"
        )


def look(state: GripperState, calibration: Calibration) -> Held | None:
    """What the fingers may hold; None where they hold nothing.

    Args:
        state: of a gripper at rest.
        calibration: counts to widths.
    """
    count, width_um = state.position_counts, calibration.width_um(state.position_counts)
    certain = state.activated and state.object_flag == CLOSING_CONTACT and state.echo_counts >= count
    short = state.echo_counts - count
    is_open = width_um >= calibration.widths_um[0] - OPEN_UM
    there = state.activated and abs(short) <= OPENED_COUNTS
    opened = is_open and (short < 0 or not state.activated)
    if not certain and (there or opened or width_um <= CLOSED_UM):
        return None
    return Held(count, width_um / 1000, certain, state.activated)


def put_down(hand: Hand, table: Table, delivery: Delivery | None, journal: Journal) -> Mapping[str, object]:
    """Lower what the fingers hold straight down where the arm stands, let go of it, retreat.

    Args:
        hand: at rest.
        table: for speed and force.
        delivery: for the area in which parts are carried.
        journal: told before and after.

    Returns:
        Where it was put down, and its width.

    Raises:
        MotionRefusedError: the arm stands outside the work area, and the area in which parts are carried.
        GripperStateError: the gripper is not ready, or the jaws do not open.
    """
    pose, count = hand.where(), hand.gripper.state().position_counts
    width_mm = hand.width_mm(count)
    wide_um = min(round(1000 * (width_mm + CLEAR_MM)), table.gripper.opening_um)
    limits = hand.limits
    if delivery is not None and delivery.area_um is not None and not _within(pose, limits.work_area_um):
        limits = replace(limits, work_area_um=delivery.area_um)
    told = {"x_mm": pose[0], "y_mm": pose[1], "position_counts": count, "width_mm": round(width_mm, 3)}
    journal.record("put_down", {**told, "begun": True})
    with hand.limited(limits):
        hand.lower(pose[0], pose[1], pose[3], width_mm)
        hand.release(table.nodes[0].squeeze._replace(opening_um=wide_um))
        hand.retreat()
    journal.record("put_down", {**told, "begun": False})
    return told


def _within(pose: PoseOfHand, area_um: tuple[int, int, int, int]) -> bool:
    x_min, y_min, x_max, y_max = area_um
    return x_min <= 1000 * pose[0] <= x_max and y_min <= 1000 * pose[1] <= y_max


def _last_end(journal: Path) -> str:
    """How a journal's last part ended, if it is one of those that may leave a part in the fingers."""
    last: Mapping[str, object] = {}
    if journal.is_file():
        for entry in records(journal):
            if entry["kind"] in ("header", "outcome", "put_down"):
                last = entry
    if last.get("outcome") not in UNDECIDED:
        return ""
    return f"; part {last['part']} of the last run in {journal} ended as {last['outcome']}"
