"""The state that a broken run left behind, and how the hand is freed without moving the part.

A part's records are written so that the last one tells what the hand may be doing: after `placed` the
fingers may be anywhere between open and closed at that node's place; after `squeeze` they hold the part, drag
it, have let go of it, or are on their way; after `freed`, and before the first of them, they touch nothing. A
squeeze that was cut short is repeated from the same place: it brings the part to where it would have.
"""

from math import hypot, remainder, tau
from pathlib import Path
from typing import NamedTuple

from drivers.ports import PoseOfHand
from runtime.devices.clock import age_s
from runtime.errors import BrokenRunError
from runtime.execution.hand import LEVEL_MM, Hand
from runtime.execution.reading import CLOSED_COUNTS, OPENED_COUNTS
from runtime.execution.safety import PLACED_MM, PLACED_RAD
from runtime.journal.chain import records
from runtime.journal.replay import Entry, Last, Replay
from runtime.table import REJECT, Node, Pose2, Table
from runtime.traversal.decision import ARRIVED, TraversalState, release_point
from runtime.traversal.geometry import placement
from runtime.traversal.results import Step

ABORT = "clear the cell, then start with --after-crash abort"


class Broken(NamedTuple):
    """Where a run broke off with a part.

    Attributes:
        part: its number.
        steps: its squeezes.
        traversal: where it stands.
        last: what the hand was doing.
        held_at: the node that squeezed it last, and the target it led to; None where it was not touched.
        delivering: whether it was being carried to its drop-off.
    """

    part: int
    steps: tuple[Step, ...]
    traversal: TraversalState
    last: Last
    held_at: tuple[int, int | None] | None
    delivering: bool


class BrokenRun(NamedTuple):
    """A run without its last record.

    Attributes:
        header: its first record.
        parts: parts that came to an outcome.
        part: the one that did not, None where it broke off between two.
        time: when it wrote its latest record, ISO 8601.
    """

    header: Entry
    parts: int
    part: Broken | None
    time: str


def broken_run(path: Path) -> BrokenRun | None:
    """The run at the end of a journal, if it broke off; None where it ended, or there is no journal.

    Raises:
        JournalError: a line does not verify.
        BrokenRunError: the run's own counts do not justify what it recorded.
    """
    if not path.exists() or not path.is_file() or not path.stat().st_size:
        return None
    replay = Replay()
    findings = list(replay.follow(records(path)))
    if replay.closed or replay.over:
        return None
    if findings:
        raise BrokenRunError(
            f"journal {path}, record {findings[-1].seq}: {findings[-1].sentence}; "
            "a run that cannot be followed is not resumed: clear the cell and use --after-crash abort"
        )
    if replay.part is None:
        return BrokenRun(replay.header, replay.parts, None, replay.time)
    part = Broken(
        replay.part,
        tuple(replay.steps),
        replay.traversal,
        replay.last,
        replay.held_at,
        replay.delivering,
    )
    return BrokenRun(replay.header, replay.parts, part, replay.time)


def restarted(broken: Broken) -> Broken:
    """The same part from the root; what the hand may hold is kept."""
    return broken._replace(steps=(), traversal=TraversalState())


def check_recent(broken: BrokenRun, now: str, most_s: float) -> None:
    """Check that a part's last record is recent enough for the part to be unchanged since.

    Args:
        broken: the run.
        now: what a record would be dated with now, ISO 8601.
        most_s: the greatest age, s.

    Raises:
        BrokenRunError: it is older, lies in the future, or is no time.
    """
    told = f"the run that broke off wrote its last record at {broken.time}"
    try:
        passed_s = age_s(broken.time, now)
    except (ValueError, TypeError):
        raise BrokenRunError(f"{told}, which is no time; {ABORT}") from None
    if passed_s < 0.0:
        raise BrokenRunError(f"{told}, and the clock says {now}: it went back; {ABORT}")
    if passed_s > most_s:
        raise BrokenRunError(
            f"{told}, {passed_s:.0f} s ago; after {most_s:g} s (--resume-within) it may be another: {ABORT}"
        )


def pending(broken: Broken, table: Table, hand: Hand) -> tuple[Node, int] | None:
    """The release that a broken run has not done yet, by the devices' state: node and branch, or None.

    Args:
        broken: what the journal knows.
        table: the table.
        hand: at rest.

    Raises:
        BrokenRunError: the hand does not stand where the run left it or holds something else, or the part may
            be in the air.
    """
    if broken.delivering:
        raise BrokenRunError("the part was being carried when the run broke off; take it out of the fingers")
    if broken.held_at is None:
        return None
    index, target = broken.held_at
    node = table.nodes[index]
    place = placement(node.squeeze)
    pose, state = hand.where(), hand.gripper.state()
    branch = next((k for k, branch in enumerate(node.branches) if branch.target == target), REJECT)
    released = release_point(node, branch)
    let_go = place if released is None else (released[0] / 1000, released[1] / 1000, place[2])
    retreat_mm = hand.limits.retreat_height_um / 1000
    low = pose[2] < retreat_mm - LEVEL_MM
    closed = state.echo_counts == CLOSED_COUNTS
    held = broken.last is Last.SQUEEZED and (closed or state.object_flag != ARRIVED)
    if held or broken.last is Last.PLACED:
        if not (low and _between(pose, place, let_go)):
            raise _moved(pose, "with the part between the fingers; take it out")
        if held and closed and broken.steps:
            _check_same_grip(state.position_counts, broken.steps[-1].position_counts)
        return node, branch
    if not broken.steps:
        return None  # nothing is believed of the part that it could not have moved away from
    coming = let_go if broken.traversal.outcome else placement(table.nodes[broken.traversal.node].squeeze)
    ways = [(let_go, let_go), (coming, coming)] if low else [(let_go, coming)]
    if pose[2] > retreat_mm + PLACED_MM or not any(_between(pose, *way) for way in ways):
        raise _moved(pose, "after it had let go of the part, which may have been moved too")
    return None


def _check_same_grip(count: int, before: int) -> None:
    if abs(count - before) > OPENED_COUNTS:
        raise BrokenRunError(
            f"the fingers stand at count {count}, the part was held at {before}: another, or gone; {ABORT}"
        )


def _moved(pose: PoseOfHand, where: str) -> BrokenRunError:
    return BrokenRunError(
        f"the arm stands at ({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f}) mm, not where the run broke off "
        f"{where}; {ABORT}"
    )


def _between(pose: PoseOfHand, start: Pose2, end: Pose2) -> bool:
    """Whether the arm stands on the way from one place to another, whatever its height."""
    off_mm = _distance(pose[:2], start[:2], end[:2])
    whole, done, left = (
        abs(remainder(a - b, tau)) for a, b in ((end[2], start[2]), (pose[3], start[2]), (end[2], pose[3]))
    )
    return off_mm <= PLACED_MM and done + left <= whole + 2 * PLACED_RAD


def _distance(point: tuple[float, ...], start: tuple[float, float], end: tuple[float, float]) -> float:
    """Distance of a point from a segment, in the plane."""
    along, across = end[0] - start[0], end[1] - start[1]
    length2 = along**2 + across**2
    share = 0.0
    if length2 > 0.0:
        share = ((point[0] - start[0]) * along + (point[1] - start[1]) * across) / length2
    share = min(max(share, 0.0), 1.0)
    return hypot(point[0] - start[0] - share * along, point[1] - start[1] - share * across)
