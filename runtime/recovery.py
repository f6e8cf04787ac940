"""What a run that broke off left behind, and how its hand is brought away without moving the part.

A part's records are written so that the last one tells what the hand may be doing: after `placed` the
fingers may be anywhere between open and closed at that node's place; after `squeeze` they hold the part, drag
it, have let go of it, or are on their way; after `freed`, and before the first of them, they touch nothing. A
squeeze that was cut short is repeated from the same place: it brings the part to where it would have.
"""

from math import hypot, remainder, tau
from pathlib import Path
from typing import NamedTuple

from runtime.decision import ARRIVED, Course
from runtime.errors import BrokenRunError
from runtime.geometry import placement
from runtime.hand import LEVEL_MM, Hand
from runtime.journal import records
from runtime.ports import Pose
from runtime.reading import CLOSED_COUNTS
from runtime.replay import Entry, Last, Replay
from runtime.results import Step
from runtime.safety import PLACED_MM, PLACED_RAD
from runtime.table import REJECT, Node, Table


class Broken(NamedTuple):
    """Where a run broke off with a part.

    Attributes:
        part: its number.
        steps: its squeezes.
        course: where it stands.
        last: what the hand was doing.
        held_at: the node whose squeeze may hold it, and the target it led to; None where nothing is held.
        delivering: whether it was being carried to its drop-off.
    """

    part: int
    steps: tuple[Step, ...]
    course: Course
    last: Last
    held_at: tuple[int, int | None] | None
    delivering: bool


class BrokenRun(NamedTuple):
    """A run without its last record.

    Attributes:
        header: its first record.
        parts: parts that came to an outcome.
        part: the one that did not, None where it broke off between two.
    """

    header: Entry
    parts: int
    part: Broken | None


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
        return BrokenRun(replay.header, replay.parts, None)
    part = Broken(
        replay.part,
        tuple(replay.steps),
        replay.course,
        replay.last,
        replay.held_at,
        replay.delivering,
    )
    return BrokenRun(replay.header, replay.parts, part)


def restarted(broken: Broken) -> Broken:
    """The same part from the root; what its hand may hold stays known."""
    return broken._replace(steps=(), course=Course())


def pending(broken: Broken, table: Table, hand: Hand) -> tuple[Node, int] | None:
    """The release a broken run still owes, read off the devices: the node and the branch, or None.

    Args:
        broken: what the journal knows.
        table: the table.
        hand: at rest.

    Raises:
        BrokenRunError: the arm does not stand where the run left it, or the part may be in the air.
    """
    if broken.delivering:
        raise BrokenRunError("the part was being carried when the run broke off; take it out of the fingers")
    if broken.held_at is None:
        return None
    index, target = broken.held_at
    node = table.nodes[index]
    pose, state = hand.where(), hand.gripper.state()
    low = pose[2] < hand.limits.retreat_height_um / 1000 - LEVEL_MM
    if broken.last is Last.PLACED:
        _check_between(pose, node, None, low=low)
        return node, REJECT
    if state.echo_counts != CLOSED_COUNTS and state.object_flag == ARRIVED:
        return None  # it was let go before the run broke off
    branch = next((k for k, branch in enumerate(node.branches) if branch.target == target), REJECT)
    _check_between(pose, node, node.release, low=low)
    return node, branch


def _check_between(pose: Pose, node: Node, release: tuple[int, int] | None, *, low: bool) -> None:
    """Check that the arm stands low on the line from where the node squeezes to where it lets go."""
    x_mm, y_mm, angle_rad = placement(node.squeeze)
    end = (x_mm, y_mm) if release is None else (release[0] / 1000, release[1] / 1000)
    off_mm = _distance(pose[:2], (x_mm, y_mm), end)
    off_rad = abs(remainder(pose[3] - angle_rad, tau))
    if not (low and off_mm <= PLACED_MM and off_rad <= PLACED_RAD):
        raise BrokenRunError(
            f"the arm stands at ({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f}) mm and the run broke off at "
            f"({x_mm:.2f}, {y_mm:.2f}) mm with the part between the fingers; take it out, clear the cell, "
            "then start with --after-crash abort"
        )


def _distance(point: tuple[float, ...], start: tuple[float, float], end: tuple[float, float]) -> float:
    """Distance of a point from a segment, in the plane."""
    along, across = end[0] - start[0], end[1] - start[1]
    length2 = along**2 + across**2
    share = 0.0
    if length2 > 0.0:
        share = ((point[0] - start[0]) * along + (point[1] - start[1]) * across) / length2
    share = min(max(share, 0.0), 1.0)
    return hypot(point[0] - start[0] - share * along, point[1] - start[1] - share * across)
