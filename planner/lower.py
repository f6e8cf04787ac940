"""Lowering: the tree of beliefs becomes the integers of the decision table."""

from __future__ import annotations

import math
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric, metric_of
from planner.belief.observation import Encoder, Partition, encoder_of
from planner.frames import wrap
from planner.job.model import Job
from planner.part.outline import radius_of_gyration
from planner.search.expand import TreeNode, breadth_first
from planner.search.handling import handling_of
from runtime.table import (
    PPM,
    Branch,
    GoalSpec,
    GripperSpec,
    Leaf,
    Limits,
    Node,
    Prediction,
    Squeeze,
    Table,
)

MARGIN_MM = 1.0
"""A branch reaches so far beyond the widths seen in planning, where no other is near: rare, not strange, or
read by an encoder that is a little off."""


def lower(root: TreeNode, job: Job) -> Table:
    """Numbers the tree breadth first and writes it down, without evaluation figures yet.

    Args:
        root: an expanded node.
        job: the job it was planned for.
    """
    encoder = encoder_of(job)
    inner, leaves = _number(root)
    nodes = tuple(_node(node, inner, leaves, job, encoder) for node in breadth_first(root) if node.children)
    ends = tuple(_leaf(node, job) for node in breadth_first(root) if not node.children)
    return Table(
        tool=_tool(),
        job_digest=job.digest(),
        gripper=_gripper(job),
        goal=_goal(job),
        limits=_limits(job, max(node.depth for node in breadth_first(root))),
        nodes=nodes,
        leaves=ends,
        predicted=Prediction(0, 0, 0),
        job=job.canonical(),
    )


def _number(root: TreeNode) -> tuple[dict[int, int], dict[int, int]]:
    """Indices of inner nodes and of leaves by identity, both breadth first."""
    inner: dict[int, int] = {}
    leaves: dict[int, int] = {}
    for node in breadth_first(root):
        numbers = inner if node.children else leaves
        numbers[id(node)] = len(numbers)
    return inner, leaves


def _node(node: TreeNode, inner: dict[int, int], leaves: dict[int, int], job: Job, encoder: Encoder) -> Node:
    assert node.squeeze is not None
    placement, opening_mm, clearance_mm, clusters, unstable, release_mm, _ = node.squeeze
    x, y, angle = placement
    squeeze = Squeeze(
        x_um=round(1e3 * x),
        y_um=round(1e3 * y),
        angle_urad=round(1e6 * float(wrap(angle))),
        opening_um=round(1e3 * opening_mm),
        speed_um_s=round(1e3 * job.gripper.speed_mm_s),
        force_mn=round(1e3 * handling_of(job).force_n(unstable)),
        clearance_um=int(1e3 * clearance_mm),
    )
    total = float(clusters.size.sum())
    branches, reach = [], _reach(clusters, encoder)
    for k, child in enumerate(node.children):
        target = inner[id(child)] if child.children else ~leaves[id(child)]
        low, high = _interval(*reach[k], encoder)
        expected = min(max(round(1e3 * float(encoder.width_mm(clusters.mean[k]))), low), high)
        share = round(PPM * float(clusters.size[k]) / total)
        branches.append(Branch(low, expected, high, share, target))
    release = None if release_mm is None else (round(1e3 * release_mm[0]), round(1e3 * release_mm[1]))
    return Node(squeeze, tuple(branches), None if release == squeeze[:2] else release)


def _reach(clusters: Partition, encoder: Encoder) -> list[tuple[int, int]]:
    """The counts of each branch: what was read in it and `MARGIN_MM` to either side, half of a narrower gap."""
    margin = math.ceil(MARGIN_MM / encoder.mm_per_count)
    gap = clusters.low[:-1] - clusters.high[1:] - 1  # counts fall as widths rise
    above = np.concatenate([[margin], np.minimum(margin, gap // 2)])
    below = np.concatenate([np.minimum(margin, gap - gap // 2), [margin]])
    return [(int(a), int(b)) for a, b in zip(clusters.low - below, clusters.high + above, strict=True)]


def _interval(low_count: int, high_count: int, encoder: Encoder) -> tuple[int, int]:
    """Widths [um] that the counts stand for."""
    least = max(0.0, float(encoder.width_mm(np.asarray(high_count + 0.5))))
    greatest = min(encoder.opening_mm, float(encoder.width_mm(np.asarray(low_count - 0.5))))
    return round(1e3 * least), round(1e3 * greatest)


def _leaf(node: TreeNode, job: Job) -> Leaf:
    x_um, y_um, theta_urad = pose_of(node.mode.pose)
    leaf = Leaf(
        x_um=x_um,
        y_um=y_um,
        theta_urad=theta_urad,
        covariance=(0, 0, 0, 0, 0, 0),
        success_ppm=round(PPM * node.mode.ratio),
        trials=0,
        resolved=node.mode.ratio >= job.goal.confidence,
        alternatives=tuple(map(pose_of, node.mode.others)),
    )
    return leaf._replace(covariance=covariance_of(node.belief.poses, leaf, job))


def pose_of(pose: Array) -> tuple[int, int, int]:
    """A pose (3,) in um and urad, its angle within half a turn."""
    x, y, theta = pose
    return round(1e3 * float(x)), round(1e3 * float(y)), round(1e6 * float(wrap(theta)))


def covariance_of(poses: Array, leaf: Leaf, job: Job) -> tuple[int, int, int, int, int, int]:
    """Second moments of poses about the leaf's pose: xx, xy, yy, xt, yt, tt in 0.1 mm and 10 mrad."""
    offset = poses - np.array([leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6])
    offset[:, 2] = wrap(offset[:, 2], job.part.symmetry)
    scaled = offset * np.array([10.0, 10.0, 100.0])
    moments = scaled.T @ scaled / max(len(scaled), 1)
    xx, xy, yy = moments[0, 0], moments[0, 1], moments[1, 1]
    xt, yt, tt = moments[0, 2], moments[1, 2], moments[2, 2]
    return round(xx), round(xy), round(yy), round(xt), round(yt), round(tt)


def _gripper(job: Job) -> GripperSpec:
    gripper = job.gripper
    return GripperSpec(
        model=gripper.model,
        opening_um=round(1e3 * gripper.opening_mm),
        finger_length_um=round(1e3 * gripper.finger_length_mm),
        finger_width_um=round(1e3 * gripper.finger_width_mm),
        count_open=gripper.count_open,
        count_closed=gripper.count_closed,
        encoder_noise_um=round(1e3 * gripper.encoder_noise_mm),
    )


def _goal(job: Job) -> GoalSpec:
    metric = metric_of(job, radius_of_gyration(job.part.outline_mm))
    return GoalSpec(
        distance_um=round(1e3 * job.goal.distance_mm),
        confidence_ppm=round(PPM * job.goal.confidence),
        rho_um=round(1e3 * radius_of_gyration(job.part.outline_mm)),
        symmetry=job.part.symmetry,
        kind=metric.kind,
        tolerance=_tolerance(metric),
        modes=metric.modes,
    )


def _tolerance(metric: Metric) -> tuple[int, int, int]:
    """The tolerances that the kind of goal looks at, um and urad; zero for the others."""
    x, y, theta = metric.tolerance
    if metric.kind == "tolerances":
        return round(1e3 * x), round(1e3 * y), round(1e6 * theta)
    return 0, 0, round(1e6 * theta) if metric.kind == "orientation" else 0


def _limits(job: Job, depth: int) -> Limits:
    cell = job.cell
    (x_min, y_min), (x_max, y_max) = cell.work_area_mm
    return Limits(
        max_depth=depth,
        max_force_mn=round(1e3 * cell.max_force_n),
        max_speed_um_s=round(1e3 * cell.max_speed_mm_s),
        work_area_um=(round(1e3 * x_min), round(1e3 * y_min), round(1e3 * x_max), round(1e3 * y_max)),
        retreat_height_um=round(1e3 * cell.retreat_height_mm),
        squeeze_height_um=round(1e3 * cell.squeeze_height_mm),
        arm_speed_um_s=round(1e3 * cell.arm_speed_mm_s),
    )


def _tool() -> str:
    try:
        return f"squeezetree {version('squeezetree')}"
    except PackageNotFoundError:
        return "squeezetree"
