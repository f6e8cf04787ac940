"""Turns plans about the origin of the world, for parts of unknown orientation.

Such a part may lie at any angle, within a circle about the origin. So a plan that is turned as a whole, with
grasp poses and leaves, locates as many parts as before. Each part's plan is turned until the angle of its
first grasp pose is that of the hand: the hand then need not turn first.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import cos, hypot, remainder, sin, tau
from typing import Any, TypeVar

from runtime.table.embedded import number, section
from runtime.table.geometry import compose
from runtime.table.model import Covariance, Leaf, LeafPose, Node, Place, Table

Pose = TypeVar("Pose", Leaf, LeafPose)
TURN_URAD = 1e6 * tau
# Kinds of goals for which a plan may be turned. "tolerances" refers to the axes of the world; "modes" is
# left out since the auditor, which is given the predicted pose, looks up the leaf's other poses by it in the
# table.
KINDS = ("pose", "orientation", "identity")


def may_turn(table: Table, job: Mapping[str, Any] | None, middle_mm: float = 0.0) -> bool:
    """Whether a table's plan may be turned by any angle: the part's uncertainty, goal and work area allow it.

    Args:
        table: the table; a plan with pushes may not be turned.
        job: the job inside the table, None where it was stripped.
        middle_mm: distance between the hand's middle and the point where the fingers meet.
    """
    if not same_from_every_side(job, table.goal.kind) or table.pushing is not None:
        return False
    places = [place for node in table.nodes for place in (node.squeeze.place, node.let_go)]
    most_mm = max(hypot(*place) for place in places) / 1e3 + abs(middle_mm)
    ends = ((most_mm, 0.0), (-most_mm, 0.0), (0.0, most_mm), (0.0, -most_mm))
    return all(table.limits.work_area_um.contains(*end) for end in ends)


def same_from_every_side(job: Mapping[str, Any] | None, kind: str) -> bool:
    """Whether the job's uncertainty and the goal's kind allow a plan to be turned."""
    halfwidth_deg = number(section(job or {}, "uncertainty"), "orientation_halfwidth_deg")
    return halfwidth_deg == 180.0 and kind in KINDS


def turned(table: Table, turn_urad: int) -> Table:
    """A copy of a table with grasp poses, places of release and leaves turned about the origin.

    The table must have no pushes.
    """
    if turn_urad == 0:
        return table
    nodes = tuple(_turned_node(node, turn_urad) for node in table.nodes)
    leaves = tuple(turned_leaf(leaf, turn_urad) for leaf in table.leaves)
    return replace(table, nodes=nodes, leaves=leaves)


def turned_leaf(leaf: Leaf, turn_urad: int) -> Leaf:
    """A copy of a leaf with its poses and its covariance turned about the origin."""
    if turn_urad == 0:
        return leaf
    return _turned_pose(leaf, turn_urad)._replace(
        covariance=_turned_covariance(leaf.covariance, turn_urad),
        alternatives=tuple(_turned_pose(other, turn_urad) for other in leaf.alternatives),
    )


def _turned(x_um: int, y_um: int, angle_urad: int, turn_urad: int) -> tuple[int, int, int]:
    x, y, _ = compose((0.0, 0.0, turn_urad / 1e6), (x_um, y_um, 0.0))
    return round(x), round(y), round(remainder(angle_urad + turn_urad, TURN_URAD))


def _turned_node(node: Node, turn_urad: int) -> Node:
    squeeze, release = node.squeeze, node.release
    x_um, y_um, angle_urad = _turned(*squeeze.place, squeeze.angle_urad, turn_urad)
    return node._replace(
        squeeze=squeeze._replace(x_um=x_um, y_um=y_um, angle_urad=angle_urad),
        release=None if release is None else Place(*_turned(*release, 0, turn_urad)[:2]),
    )


def _turned_pose(pose: Pose, turn_urad: int) -> Pose:
    x_um, y_um, theta_urad = _turned(pose.x_um, pose.y_um, pose.theta_urad, turn_urad)
    return pose._replace(x_um=x_um, y_um=y_um, theta_urad=theta_urad)


def _turned_covariance(moments: Covariance, turn_urad: int) -> Covariance:
    c, s = cos(turn_urad / 1e6), sin(turn_urad / 1e6)
    xx, xy, yy, xt, yt, tt = moments
    return Covariance(
        round(c * c * xx - 2.0 * c * s * xy + s * s * yy),
        round(c * s * (xx - yy) + (c * c - s * s) * xy),
        round(s * s * xx + 2.0 * c * s * xy + c * c * yy),
        round(c * xt - s * yt),
        round(s * xt + c * yt),
        tt,
    )
