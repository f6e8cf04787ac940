"""Checks that the last squeeze could hold the part of the embedded job at a leaf's pose.

A held part touches both fingers and does not overlap them. So two conditions are checked for the part's
outline at the leaf's pose, with an allowance for the leaf's error and for the uncertainties (doubts) that the
job states:

- the outline reaches the faces of both fingers, between the ends of the fingers;
- the outline has no points just behind the face of a finger, where the finger itself is. Points farther
  behind the face are allowed, since the finger may stand in a slot.
"""

from collections.abc import Iterator
from itertools import repeat
from math import cos, hypot, inf, pi, radians, sin
from typing import NamedTuple

from runtime.errors import TableError
from runtime.table.embedded import Section, number, numbers, parts_of, points, section
from runtime.table.geometry import Outline, Pose2, from_segment, gyration_mm
from runtime.table.goal import hypotheses_of, poses_of
from runtime.table.model import HELD_UM, Branch, Leaf, Node, Table

MOST_POINTS = 48  # points of an outline, so that hundreds of leaves are checked in milliseconds
DIRECTIONS = 90  # directions in which the narrowest width is searched
MARGIN_MM = 0.5
TAIL = 4.0  # standard deviations
WAVES = 3.0  # deviation of a wavy contour from its drawing, in units of its tolerance


class Shape(NamedTuple):
    """The outline of a part, with few points; lengths in mm."""

    outline: Outline
    reach: float  # farthest point from the origin
    rho: float  # radius of gyration
    narrowest: float  # least width
    # largest distance of a removed point from the outline of the points that are kept
    coarse: float


class Slack(NamedTuple):
    """Largest errors of hand and jaws that the uncertainties (doubts) in the job allow; 0 without any."""

    place_mm: float
    turn_rad: float
    width_mm: float
    gain: float  # error of a width, for each mm of the width
    share: float  # error of a finger's share of the closing
    lead: float  # planned share of the closing of the finger at +y, less one half


class Grip(NamedTuple):
    """The faces of the closed jaws, and how far they may be off; lengths in mm."""

    hand: Pose2  # pose of the hand in the world, where the jaws release the part
    half_length: float  # half the length of a finger
    low: float  # y of the lower face in the hand frame
    high: float
    off: float  # largest error of the place of either face


def validate_grips(table: Table, job: Section) -> None:
    """Checks the squeezes of a table against the outlines of the parts in the job.

    The first squeeze must be able to touch a part. At each resolved leaf after a squeeze that holds a part,
    the jaws must be able to hold the part at the leaf's pose.

    Raises:
        TableError: the first squeeze can touch no part, or the jaws could not hold the part at a leaf's pose;
            the message names the first such leaf.
    """
    if not (shapes := _shapes(table, job)):
        return
    _validate_first(table, job, max(shape.reach for shape in shapes), _slack(job))
    for which, index in not_held(table, job):
        leaf = table.leaves[which]
        raise TableError(
            f"leaf {which}: the part of the embedded job, at ({leaf.x_um / 1e3:.2f}, "
            f"{leaf.y_um / 1e3:.2f}) mm, does not lie between the jaws of node {index}; recompile it"
        )


def not_held(table: Table, job: Section) -> Iterator[tuple[int, int]]:
    """Yields the resolved leaves at whose pose the jaws could not hold the part.

    Yields pairs of two indices: the leaf's, and that of the node of the last squeeze before the leaf.
    """
    shapes, slack = _shapes(table, job), _slack(job)
    for index, node, branch, leaf in _grips(table) if shapes else ():
        error_mm = _error_mm(table, leaf)
        poses = poses_of(table.goal, leaf)
        named = [shapes[which] for which in hypotheses_of(table.goal, leaf)]
        grips = [_grip(table, node, branch, shape, slack) for shape in named]
        if not any(map(_is_held, named, poses, grips, repeat(error_mm))):
            yield ~branch.target, index


def _shapes(table: Table, job: Section) -> list[Shape]:
    """Shapes of the job's parts; empty if a part has no outline, or the goal does not identify parts."""
    outlines = [points(section(part, "part"), "outline_mm") for part in parts_of(job)]
    if not outlines or min(map(len, outlines)) < 3 or not table.goal.identify:
        return []
    return [_shape(outline) for outline in outlines]


def _validate_first(table: Table, job: Section, reach_mm: float, slack: Slack) -> None:
    """Checks that the first squeeze can touch a part within the job's uncertainty."""
    radius_mm, root = number(section(job, "uncertainty"), "radius_mm"), table.nodes[0]
    if radius_mm is None or root.pushes:
        return
    x_mm, y_mm = root.squeeze.x_um / 1e3, root.squeeze.y_um / 1e3
    most_mm = hypot(root.squeeze.opening_um, table.gripper.finger_length_um) / 2e3
    most_mm += radius_mm + reach_mm + slack.place_mm + MARGIN_MM
    if hypot(x_mm, y_mm) > most_mm:
        raise TableError(
            f"node 0: at ({x_mm:.2f}, {y_mm:.2f}) mm the jaws touch no part within radius_mm = {radius_mm:g} "
            "of the embedded job; recompile it"
        )


def _grips(table: Table) -> Iterator[tuple[int, Node, Branch, Leaf]]:
    """Yields each branch of the table at which the jaws hold a part and that leads to a resolved leaf.

    Yields the index of the node, the node, the branch, and the leaf.
    """
    for index, node in enumerate(table.nodes):
        for branch in node.branches:
            held = branch.target < 0 and branch.low_um > 0 and branch.expected_um >= HELD_UM
            if held and (leaf := table.leaves[~branch.target]).resolved:
                yield index, node, branch, leaf


def _error_mm(table: Table, leaf: Leaf) -> float:
    """Error (eq. 9), mm, to allow for at a leaf's pose: the median of the trials that ended at the leaf.

    Without trials it is the largest error that the goal allows: infinite if the goal does not bound the
    position.
    """
    if leaf.trials:
        return leaf.error_median_um / 1e3
    goal = table.goal
    if goal.kind in ("pose", "modes"):
        return goal.distance_um / 1e3
    if goal.kind != "tolerances":
        return inf
    tolerance = goal.tolerance
    shift_um = hypot(tolerance.x_um, tolerance.y_um)
    return (shift_um + goal.rho_um * tolerance.theta_urad / 1e6) / 1e3


def _grip(table: Table, node: Node, branch: Branch, shape: Shape, slack: Slack) -> Grip:
    """Where the faces of the jaws are at the place of release, if closed to a branch's expected width."""
    squeeze, expected = node.squeeze, branch.expected_um / 1e3
    place = node.let_go
    read = max(branch.high_um - branch.expected_um, branch.expected_um - branch.low_um) / 1e3
    width = read + slack.width_mm + slack.gain * branch.high_um / 1e3
    middle = -slack.lead * (squeeze.opening_um / 1e3 - expected)
    uneven = slack.share * (abs(expected - shape.narrowest) + width) + abs(slack.lead) * width
    turned = slack.turn_rad * (shape.reach + squeeze.opening_um / 2e3)
    return Grip(
        (place.x_um / 1e3, place.y_um / 1e3, squeeze.angle_urad / 1e6),
        table.gripper.finger_length_um / 2e3,
        middle - expected / 2,
        middle + expected / 2,
        width / 2 + uneven + turned + slack.place_mm + MARGIN_MM,
    )


def _is_held(shape: Shape, pose: Pose2, grip: Grip, error_mm: float) -> bool:
    """Whether the jaws can hold a part at its pose, or at one that differs by `error_mm` (eq. 9) at most."""
    off = grip.off + shape.coarse + error_mm * max(1.0, shape.reach / max(shape.rho, 1e-9))
    outline = _in_hand(shape.outline, pose, grip.hand)
    low, high = _extent(outline, grip.half_length + off)
    if low > grip.low + off or high < grip.high - off:
        return False
    inner = grip.half_length - off
    return not (_blocks(outline, grip.low - off, inner) or _blocks(outline, grip.high + off, inner))


def _in_hand(outline: Outline, pose: Pose2, hand: Pose2) -> Outline:
    """Transforms the outline of a part at a pose in the world to the frame of the hand."""
    turn = pose[2] - hand[2]
    c, s, ch, sh = cos(turn), sin(turn), cos(hand[2]), sin(hand[2])
    dx, dy = pose[0] - hand[0], pose[1] - hand[1]
    x0, y0 = ch * dx + sh * dy, ch * dy - sh * dx
    return [(x0 + c * x - s * y, y0 + s * x + c * y) for x, y in outline]


def _extent(outline: Outline, half: float) -> tuple[float, float]:
    """Least and greatest y of an outline's points where |x| <= half; inf and -inf without any."""
    low, high = inf, -inf
    if half <= 0.0:
        return low, high
    x0, y0 = outline[-1]
    for x1, y1 in outline:
        if -half <= x1 <= half:
            low, high = min(low, y1), max(high, y1)
        for x in (-half, half):
            if (x0 - x) * (x1 - x) < 0.0:
                y = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
                low, high = min(low, y), max(high, y)
        x0, y0 = x1, y1
    return low, high


def _blocks(outline: Outline, y: float, half: float) -> bool:
    """Whether a piece of the segment from (-half, y) to (half, y) lies inside an outline."""
    crossings = list[float]()
    x0, y0 = outline[-1]
    for x1, y1 in outline:
        if (y0 > y) != (y1 > y):
            crossings.append(x0 + (x1 - x0) * (y - y0) / (y1 - y0))
        x0, y0 = x1, y1
    crossings.sort()
    return any(
        max(start, -half) < min(end, half)
        for start, end in zip(crossings[::2], crossings[1::2], strict=True)
    )


def _shape(outline: Outline) -> Shape:
    """The shape of a part; its outline is thinned, at equal steps, to at most `MOST_POINTS` points."""
    step = -(-len(outline) // MOST_POINTS)
    kept, coarse = outline[::step], 0.0
    for k, start in enumerate(kept):
        end = kept[(k + 1) % len(kept)]
        left_out = outline[k * step + 1 : (k + 1) * step]
        coarse = max([coarse, *(from_segment(point, start, end) for point in left_out)])
    turns = [pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    across = [[cos(turn) * x + sin(turn) * y for x, y in kept] for turn in turns]
    narrowest = min(max(row) - min(row) for row in across)
    reach = max(hypot(*point) for point in outline)
    return Shape(kept, reach, gyration_mm(outline), narrowest, coarse)


def _slack(job: Section) -> Slack:
    """The largest errors that a job's uncertainties allow; for a random error, `TAIL` standard deviations."""
    gripper, doubt, release = (section(job, name) for name in ("gripper", "doubt", "release"))

    def most(table: Section, key: str) -> float:
        return max(map(abs, numbers(table, key)), default=0.0)

    parts = [section(entry, "part") for entry in (job, *parts_of(job))]
    contour = WAVES * max(most(part, "tolerance_mm") for part in parts)
    share = number(gripper, "upper_finger_share")
    return Slack(
        place_mm=most(doubt, "middle_mm") + TAIL * most(release, "shift_mm") + contour,
        turn_rad=radians(TAIL * most(release, "turn_deg")),
        width_mm=most(doubt, "encoder_mm") + TAIL * most(gripper, "noise_mm") + 2 * contour,
        gain=most(doubt, "encoder_gain"),
        share=most(doubt, "finger_share"),
        lead=0.0 if share is None else share - 0.5,
    )
