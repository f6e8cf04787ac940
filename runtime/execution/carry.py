"""Chooses, checks and executes the delivery of a localised part: the last grasp, the path to the drop-off.

Several paths may be equivalent: a symmetric part may be put down turned by a period of its symmetry, and a
hand whose fingers close alike may itself be turned by half a turn. Of the equivalent paths within the areas,
the arm's reach and the wrist's range, the one that turns the hand least is used.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from math import degrees, inf, pi, tau
from typing import NamedTuple

from drivers.ports import Arm, ObjectState, PoseOfHand
from runtime.errors import GripperStateError, MotionRefusedError
from runtime.execution import safety
from runtime.execution.delivery import Delivery, Places
from runtime.execution.hand import Hand
from runtime.execution.reading import room_um
from runtime.execution.strokes import of_any_width
from runtime.table import Leaf, Limits, Node, Pose2, Table, close_alike, predicted_pose
from runtime.table.geometry import compose, placement, same_turns, sent


class Way(NamedTuple):
    """Poses of the hand where it takes the part and where it puts it down: mm, mm, rad (not modulo 2 pi)."""

    taken: Pose2
    put: Pose2


def check(
    delivery: Places | None, table: Table, arm: Arm | None = None, middle_mm: float = 0.0
) -> None:
    """Checks, before anything moves, that parts can be delivered from every resolved leaf.

    Leaves of a part without a delivery are not checked.

    Args:
        delivery: where parts are put down; None: nothing is checked.
        table: the table whose leaves are checked.
        arm: reports its reach and its wrist's range; without it only the areas are checked.
        middle_mm: distance from the hand's middle at which the fingers meet.

    Raises:
        MotionRefusedError: there is no path from a leaf; the message names the first such leaf.
    """
    if delivery is None:
        return
    for node in table.nodes:
        x_mm, y_mm, angle_rad = placement(node.squeeze, node.release)
        start = (x_mm, y_mm, table.limits.retreat_height_um / 1000, angle_rad)
        for branch in node.branches:
            if branch.target >= 0 or not table.leaves[~branch.target].resolved:
                continue
            leaf = table.leaves[~branch.target]
            place = delivery.of(leaf.hypothesis)
            if place is None:
                continue
            try:
                choose(place, table, leaf, start, arm, middle_mm)
            except MotionRefusedError as error:
                raise MotionRefusedError(f"delivery from leaf {~branch.target}: {error}") from error


def choose(
    delivery: Delivery,
    table: Table,
    leaf: Leaf,
    start: PoseOfHand,
    arm: Arm | None,
    middle_mm: float = 0.0,
) -> Way:
    """Chooses, among the equivalent paths for the part of a leaf, the one that turns the hand least.

    Args:
        delivery: where the part is grasped and put down.
        table: the table of the leaf.
        leaf: states the part's pose.
        start: pose of the hand before the delivery.
        arm: reports its reach and its wrist's range; without it only the areas are checked.
        middle_mm: distance from the hand's middle at which the fingers meet.

    Returns:
        The two places to which the arm is sent, so that the fingers meet at the part and at the drop-off.

    Raises:
        MotionRefusedError: there is no path; the message says why the simplest one is refused.
    """
    # by the positions of both places: a refusal does not depend on the hand's angle
    refusals: dict[tuple[float, ...], str] = {}
    results: list[tuple[float, Way]] = []
    for taken, put in _same(delivery, table, leaf):
        to = Way(sent(taken, middle_mm), sent(put, middle_mm))
        places = (*to.taken[:2], *to.put[:2])
        if places not in refusals:
            refusals[places] = _refusal(delivery, table.limits, start, to, arm)
        if refusals[places]:
            continue
        for here, there in product(_turns(taken, start[3], arm), _turns(put, start[3], arm)):
            turn = abs(here[2] - start[3]) + abs(there[2] - here[2])
            results.append((turn, Way(here, there)))
    if not results:
        x_mm, y_mm, angle_rad = compose(delivery.drop, delivery.grasp)
        raise MotionRefusedError(
            next(iter(refusals.values()))
            or f"the wrist cannot turn the hand to {degrees(angle_rad):.1f} deg at "
            f"({x_mm:.2f}, {y_mm:.2f}) mm, or not to where the part is taken"
        )
    return min(results)[1]


def deliver(hand: Hand, delivery: Delivery, leaf: Leaf, table: Table) -> str | None:
    """Grasps the part of a leaf with the root's speed and force, carries it and puts it down.

    Returns:
        None if the part was put down, else why it was left: no path exists, or the last grasp holds nothing
        or has a width that the delivery does not allow.

    Raises:
        GripperStateError: the part slipped out while it was carried, or the gripper is not ready.
    """
    hand.retreat()
    try:
        taken, put = choose(delivery, table, leaf, hand.where(), hand.arm, hand.middle_mm)
    except MotionRefusedError as error:
        return f"the part was not taken: {error}"
    node = _grasp_node(table)
    hand.jaws.open(node.squeeze)
    hand.travel_as_counted(*taken)
    hand.descend(*taken)
    reading = hand.close(node)
    width_mm = hand.jaws.width_mm(reading.width_um)
    low_mm, high_mm = delivery.width_mm
    if reading.object is ObjectState.AT_TARGET or not low_mm <= width_mm <= high_mm:
        hand.release(node.squeeze)
        hand.retreat()
        expected = f"{low_mm:g}..{high_mm:g} mm"
        return f"the fingers read {width_mm:.2f} mm at the last grasp, expected was {expected}"
    with hand.limited(_carrying(delivery, hand.limits)):
        hand.retreat()
        _check_held(hand, reading.width_um)
        hand.travel_as_counted(*put)
        _check_held(hand, reading.width_um)
        hand.lower(*put, width_mm)
        hand.release(node.squeeze)
        hand.retreat()
    return None


def _same(delivery: Delivery, table: Table, leaf: Leaf) -> Iterator[Way]:
    """Yields all equivalent ways to take and put down a leaf's part; first the one without an added turn."""
    halves = (0.0, pi) if close_alike(table) else (0.0,)
    x_mm, y_mm, theta_rad = delivery.drop
    symmetry = table.goal_of(leaf.hypothesis).symmetry
    for turn, half in product(range(symmetry), halves):
        taken = compose(predicted_pose(leaf), delivery.grasp)
        put = compose((x_mm, y_mm, theta_rad + tau * turn / symmetry), delivery.grasp)
        yield Way((*taken[:2], taken[2] + half), (*put[:2], put[2] + half))


def _refusal(
    delivery: Delivery, limits: Limits, start: PoseOfHand, to: Way, arm: Arm | None
) -> str:
    """Why the arm cannot take a part at one place and put it down at the other, or an empty string."""
    taken, put = to
    low_mm, high_mm = limits.squeeze_height_um / 1000, limits.retreat_height_um / 1000
    carrying = _carrying(delivery, limits)
    for doing, (x_mm, y_mm, angle_rad), area in (
        ("taking the part", taken, limits),
        ("carrying it away", taken, carrying),
        ("putting it down", put, carrying),
    ):
        for height_mm in (low_mm, high_mm):
            try:
                safety.check_target((x_mm, y_mm, height_mm, angle_rad), area)
            except MotionRefusedError as error:
                return f"{doing}: {error}"
    if arm is None:
        return ""
    above, beyond = (*taken[:2], high_mm, taken[2]), (*put[:2], high_mm, put[2])
    at, down = (*taken[:2], low_mm, taken[2]), (*put[:2], low_mm, put[2])
    for doing, here, there in (
        ("taking the part", start, above),
        ("taking the part", above, at),
        ("carrying it away", above, beyond),
        ("putting it down", beyond, down),
    ):
        if obstacle := arm.obstacle(here, there):
            return f"{doing}: the way is {obstacle}"
    return ""


def _turns(place: Pose2, near_rad: float, arm: Arm | None) -> list[Pose2]:
    """Lists a place once for each angle in the wrist's range that equals its angle up to whole turns.

    The place with the angle nearest to `near_rad` comes first.
    """
    x_mm, y_mm, angle_rad = place
    low_rad, high_rad = (-inf, inf) if arm is None else arm.turn_range(x_mm, y_mm)
    return [(x_mm, y_mm, turn) for turn in same_turns(angle_rad, low_rad, high_rad, near_rad)]


def _carrying(delivery: Delivery, limits: Limits) -> Limits:
    """The limits while the part is carried: with the delivery's area, if stated, as the work area."""
    return limits if delivery.area_um is None else replace(limits, work_area_um=delivery.area_um)


def _grasp_node(table: Table) -> Node:
    """The node of the last grasp: the root's squeeze from fully open jaws, with one branch for any width."""
    squeeze = table.nodes[0].squeeze._replace(opening_um=table.gripper.opening_um)
    widest_um = max(branch.high_um for node in table.nodes for branch in node.branches)
    return of_any_width(table.nodes[0], squeeze, widest_um)


def _check_held(hand: Hand, reading_um: int) -> None:
    state = hand.gripper.state()
    moved = abs(state.width_um - reading_um) > room_um(hand.calibration.profile)
    if moved or state.object is not ObjectState.CLOSING:
        raise GripperStateError("the part slipped out of the fingers while it was carried; find it")
