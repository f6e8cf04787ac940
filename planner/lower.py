"""Lowering: converts a tree of beliefs to a decision table, whose numbers are integers."""

from importlib.metadata import PackageNotFoundError, version

import numpy as np

from planner.arrays import Array
from planner.belief.metric import metric_of
from planner.belief.observation import Encoder, Partition, encoder_of, resolution_of
from planner.belief.particles import Belief
from planner.belief.stopping import StoppingRule
from planner.belief.transition import Push, finger_speed_mm_s
from planner.frames import wrap
from planner.job.cell import gripper_of, limits_of
from planner.job.model import Job
from planner.search.handling import Handling
from planner.search.tree import Node, breadth_first
from runtime import table as tables


def lower(root: Node, job: Job) -> tables.Table:
    """Converts a job's tree to a table without evaluation figures; nodes are numbered breadth first."""
    encoder = encoder_of(job)
    nodes = [node for node in breadth_first(root) if node.children]
    leaves = [node for node in breadth_first(root) if not node.children]
    targets = {id(node): index for index, node in enumerate(nodes)}
    targets |= {id(leaf): ~index for index, leaf in enumerate(leaves)}
    return tables.Table(
        tool=_tool(),
        job_digest=job.digest(),
        gripper=gripper_of(job),
        goal=_goal(job),
        limits=limits_of(job, max(leaf.depth for leaf in leaves)),
        nodes=tuple(_node(node, targets, job, encoder) for node in nodes),
        leaves=tuple(_leaf(leaf, job) for leaf in leaves),
        predicted=tables.Prediction(0, 0, 0),
        job=job.canonical(),
        hypotheses=_hypotheses(job),
    )


def _node(node: Node, targets: dict[int, int], job: Job, encoder: Encoder) -> tables.Node:
    assert node.squeeze is not None
    planned, clusters = node.squeeze, node.squeeze.clusters
    x_um, y_um, angle_urad = pose_of(planned.placement)
    squeeze = tables.Squeeze(
        x_um=x_um,
        y_um=y_um,
        angle_urad=angle_urad,
        opening_um=round(1e3 * planned.opening_mm),
        speed_um_s=round(1e3 * job.gripper.speed_mm_s),
        force_mn=round(1e3 * job.gripper.force_n),
        clearance_um=int(1e3 * planned.clearance_mm),
    )
    total = float(clusters.size.sum())
    branches, reach = [], _reach(clusters, encoder)
    for k, child in enumerate(node.children):
        low, high = interval_um(*reach[k], encoder)
        expected = min(max(round(1e3 * float(encoder.width_mm(clusters.mean[k]))), low), high)
        share = round(tables.PPM * float(clusters.size[k]) / total)
        branches.append(tables.Branch(low, expected, high, share, targets[id(child)]))
    release = None
    if planned.release is not None:
        release = tables.Place(*(round(1e3 * value) for value in planned.release[:2]))
    pushed = tuple(_push(push, job) for push in planned.pushes)
    contact = None
    if not pushed:
        contact_mm = Handling(job).contact_mm(node.belief, planned.placement)
        contact = max(round(1e3 * contact_mm), *(branch.high_um for branch in branches))
        contact = contact if contact < squeeze.opening_um else None
        release = None if release == squeeze.place else release
    return tables.Node(squeeze, tuple(branches), release, pushed, contact)


def _push(push: Push, job: Job) -> tables.Push:
    speed_mm_s = min(finger_speed_mm_s(job.gripper.speed_mm_s), job.cell.arm_speed_mm_s)
    numbers = (push.opening_mm, push.way_mm, speed_mm_s)
    return tables.Push(*pose_of(push.start), *(round(1e3 * number) for number in numbers))


def _reach(clusters: Partition, encoder: Encoder) -> list[tuple[int, int]]:
    """Returns the least and the greatest reading of each branch: its cluster's, with a margin added.

    A margin is at most half of the gap to the next cluster. A thin part may read like an empty hand; the
    object flag distinguishes the two. So the branch of a thin part extends to the last reading before the
    reading of closed jaws.
    """
    resolution = resolution_of(encoder)
    free, margin = resolution.free, resolution.margin
    gap = np.maximum(clusters.low[:-1] - clusters.high[1:] - 1, 0)  # readings fall as widths rise
    above = np.concatenate([[margin], np.minimum(margin, gap // 2)])
    thin = (clusters.low < free) & (clusters.high >= free - 1)
    above = np.where(thin, encoder.steps - 1 - clusters.high, above)
    below = np.concatenate([np.minimum(margin, gap - gap // 2), [margin]])
    return [
        (int(a), int(b)) for a, b in zip(clusters.low - below, clusters.high + above, strict=True)
    ]


def interval_um(low: int, high: int, encoder: Encoder) -> tuple[int, int]:
    """Returns the least and the greatest width [um] whose reading is from `low` to `high`, without noise."""
    least = max(0.0, float(encoder.width_mm(np.asarray(high + 0.5))))
    greatest = min(encoder.opening_mm, float(encoder.width_mm(np.asarray(low - 0.5))))
    return round(1e3 * least), round(1e3 * greatest)


def _leaf(node: Node, job: Job) -> tables.Leaf:
    x_um, y_um, theta_urad = pose_of(node.mode.pose)
    trials = node.belief[: node.fresh].states
    within = metric_of(job).explained(trials, node.mode) if len(trials) else node.mode.ratio
    leaf = tables.Leaf(
        x_um=x_um,
        y_um=y_um,
        theta_urad=theta_urad,
        covariance=tables.Covariance(0, 0, 0, 0, 0, 0),
        success_ppm=round(tables.PPM * float(np.mean(within))),
        trials=len(trials),
        resolved=StoppingRule(job.goal.confidence).holds(node.mode.ratio, len(node.belief)),
        alternatives=tuple(
            tables.LeafPose(*pose_of(pose), which)
            for pose, which in zip(node.mode.others, node.mode.hypothesis[1:], strict=True)
        ),
        hypothesis=node.mode.hypothesis[0],
    )
    return leaf._replace(covariance=covariance_of(node.belief, leaf, job))


def pose_of(pose: Array) -> tuple[int, int, int]:
    """Converts a pose (3,) [mm, mm, rad] to um and urad, with the angle within half a turn of 0."""
    x, y, theta = pose
    return round(1e3 * float(x)), round(1e3 * float(y)), round(1e6 * float(wrap(theta)))


def covariance_of(belief: Belief, leaf: tables.Leaf, job: Job) -> tables.Covariance:
    """Returns the second moments of a belief about the pose of a leaf.

    Only parts of the leaf's hypothesis count; the moments are 0 if there are none. Lengths are in 0.1 mm,
    angles in 10 mrad.
    """
    named = belief.traits["hypothesis"] == leaf.hypothesis
    offset = belief.poses[named] - tables.predicted_pose(leaf)
    offset[:, 2] = wrap(offset[:, 2], job.alone[leaf.hypothesis].part.symmetry)
    scaled = offset * np.array([10.0, 10.0, 100.0])
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = scaled.T @ scaled / max(len(scaled), 1)
    return tables.Covariance(*map(round, (xx, xy, yy, xt, yt, tt)))


def _goal(job: Job) -> tables.GoalSpec:
    metric = metric_of(job)
    scaled = zip((1e3, 1e3, 1e6), metric.tolerance, strict=True)
    stated = tables.Tolerance(*(round(scale * value) for scale, value in scaled))
    # A table states 0 for a tolerance that its kind of goal does not use.
    tolerance = {
        "tolerances": stated,
        "orientation": stated._replace(x_um=0, y_um=0),
    }.get(metric.kind, tables.Tolerance(0, 0, 0))
    return tables.GoalSpec(
        distance_um=round(1e3 * job.goal.distance_mm),
        confidence_ppm=round(tables.PPM * job.goal.confidence),
        rho_um=round(1e3 * metric.rho_mm),
        symmetry=job.part.symmetry,
        kind=metric.kind,
        tolerance=tolerance,
        modes=metric.modes,
        identify=metric.identify or not job.hypothesis,
    )


def _hypotheses(job: Job) -> tuple[tables.Hypothesis, ...]:
    if not job.hypothesis:
        return ()
    metric = metric_of(job)
    each = zip(job.alone, job.shares, [(metric.rho_mm, metric.order), *metric.further], strict=True)
    return tuple(
        tables.Hypothesis(alone.part.name, round(tables.PPM * share), round(1e3 * rho_mm), order)
        for alone, share, (rho_mm, order) in each
    )


def _tool() -> str:
    try:
        return f"squeezetree {version('squeezetree')}"
    except PackageNotFoundError:
        return "squeezetree"
