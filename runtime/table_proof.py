"""The proof of a table: every reason not to execute it, looked for at every write and every read."""

import hashlib
from math import exp, log, sqrt

from runtime.errors import TableError
from runtime.table_lookup import REJECT, Calibration, count_map
from runtime.table_model import (
    MAX_ANGLE_URAD,
    MAX_BRANCHES,
    MAX_DEPTH,
    MAX_LEAVES,
    MAX_NODES,
    PPM,
    WIDTH_GRID_UM,
    GripperSpec,
    Leaf,
    Limits,
    Node,
    Table,
)

WILSON_Z = 1.959964  # two-sided 95 %
LEVEL = 0.025
MOST_TERMS = 1000
LEAST_LOG = -700.0  # exp of less is zero


def prove(table: Table) -> None:
    """Check that a table may be executed.

    Raises:
        TableError: naming the first node, branch, leaf or field that is wrong.
    """
    prove_header(table)
    prove_shape(table)
    calibration = Calibration.linear(table.gripper)
    for index, node in enumerate(table.nodes):
        _prove_squeeze(f"node {index}", node, table)
        _prove_branches(f"node {index}", node, table.gripper, calibration)
    for index, leaf in enumerate(table.leaves):
        _prove_leaf(f"leaf {index}", leaf, table)


def prove_header(table: Table) -> None:
    """Check everything about a table but its tree.

    Raises:
        TableError: a field is of the wrong type or out of range, or the job is not the one of the digest.
    """
    _text("tool", table.tool)
    _text("gripper.model", table.gripper.model)
    if not isinstance(table.job_digest, bytes) or len(table.job_digest) != 32:
        raise TableError("job_digest is not 32 bytes")
    if table.job is not None:
        _text("job", table.job)
        if hashlib.sha256(table.job.encode()).digest() != table.job_digest:
            raise TableError("the embedded job is not the one the table was made from; recompile it")
    _prove_gripper(table.gripper)
    goal, predicted = table.goal, table.predicted
    _within("goal.distance_um", goal.distance_um, 1)
    _within("goal.confidence_ppm", goal.confidence_ppm, 0, PPM)
    _within("goal.rho_um", goal.rho_um, 0)
    _within("goal.symmetry", goal.symmetry, 1, 1000)
    _within("predicted.success_ppm", predicted.success_ppm, 0, PPM)
    _within("predicted.trials", predicted.trials, 0)
    _within("predicted.mean_squeezes_ppm", predicted.mean_squeezes_ppm, 0, MAX_DEPTH * PPM)
    _within("predicted.reject_ppm", predicted.reject_ppm, 0, PPM)
    _prove_limits(table.limits)


def prove_shape(table: Table) -> None:
    """Check that the targets form one tree: each node and leaf reached exactly once, depth bounded.

    Raises:
        TableError: naming the first node or leaf that is reached twice, never, or too deep.
    """
    _within("number of nodes", len(table.nodes), 1, MAX_NODES)
    _within("number of leaves", len(table.leaves), 1, MAX_LEAVES)
    nodes_reached = [False] * len(table.nodes)
    leaves_reached = [False] * len(table.leaves)
    nodes_reached[0] = True
    level, depth = [0], 0
    while level:
        depth += 1
        if depth > table.limits.max_depth:
            raise TableError(f"node {level[0]} is deeper than limits.max_depth = {table.limits.max_depth}")
        deeper = []
        for index in level:
            for number, branch in enumerate(table.nodes[index].branches):
                where = f"node {index}, branch {number}"
                _within_of(where, "target", branch.target, -len(table.leaves), len(table.nodes) - 1)
                reached, kind = (nodes_reached, "node") if branch.target >= 0 else (leaves_reached, "leaf")
                target = branch.target if branch.target >= 0 else ~branch.target
                if reached[target]:
                    raise TableError(f"{where}: {kind} {target} is reached a second time")
                reached[target] = True
                if branch.target >= 0:
                    deeper.append(target)
        level = deeper
    for reached, kind in ((nodes_reached, "node"), (leaves_reached, "leaf")):
        if not all(reached):
            raise TableError(f"{kind} {reached.index(False)} is never reached")


def wilson_upper(successes: float, trials: int) -> float:
    """Upper end of the 95 % Wilson score interval of a share; 1 without trials."""
    if trials == 0:
        return 1.0
    share, z2 = successes / trials, WILSON_Z**2
    spread = WILSON_Z * sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    return (share + z2 / (2 * trials) + spread) / (1 + z2 / trials)


def refuted(successes: int, trials: int, confidence: float) -> bool:
    """Whether trials speak against a success probability of at least `confidence`, at the 2.5 % level.

    Exact binomial test (Clopper and Pearson 1934) where its sum is short; Wilson's interval for more misses
    than that, where the two agree. Thin leaves need the exact one: one miss in ten trials refutes nothing.
    """
    misses, log_none = trials - successes, trials * log(confidence)
    if misses > MOST_TERMS or log_none < LEAST_LOG:
        return wilson_upper(successes, trials) < confidence
    term, fewer = exp(log_none), 0.0  # probability of k misses, and of fewer than `misses`
    for k in range(misses):
        fewer += term
        term *= (trials - k) / (k + 1) * (1.0 - confidence) / confidence
    return 1.0 - fewer < LEVEL


def _prove_gripper(gripper: GripperSpec) -> None:
    _within("gripper.opening_um", gripper.opening_um, 1, 1_000_000)
    _within("gripper.finger_length_um", gripper.finger_length_um, 1, 1_000_000)
    _within("gripper.finger_width_um", gripper.finger_width_um, 1, 1_000_000)
    _within("gripper.count_closed", gripper.count_closed, 1, 255)
    _within("gripper.count_open", gripper.count_open, 0, gripper.count_closed - 1)
    _within("gripper.encoder_noise_um", gripper.encoder_noise_um, 0, gripper.opening_um)


def _prove_limits(limits: Limits) -> None:
    _within("limits.max_depth", limits.max_depth, 1, MAX_DEPTH)
    _within("limits.max_force_mn", limits.max_force_mn, 1)
    _within("limits.max_speed_um_s", limits.max_speed_um_s, 1)
    _within("limits.arm_speed_um_s", limits.arm_speed_um_s, 1)
    area = limits.work_area_um
    if not isinstance(area, tuple) or len(area) != 4:
        raise TableError("limits.work_area_um is not x min, y min, x max, y max")
    for name, value in zip(("x min", "y min", "x max", "y max"), area, strict=True):
        _integer(f"limits.work_area_um {name}", value)
    if area[0] >= area[2] or area[1] >= area[3]:
        raise TableError(f"limits.work_area_um is empty: {area}")
    _integer("limits.squeeze_height_um", limits.squeeze_height_um)
    _within("limits.retreat_height_um", limits.retreat_height_um, limits.squeeze_height_um + 1)


def _prove_squeeze(where: str, node: Node, table: Table) -> None:
    squeeze, limits = node.squeeze, table.limits
    _in_area(f"{where}: squeeze", squeeze.x_um, squeeze.y_um, limits)
    _within_of(where, "angle_urad", squeeze.angle_urad, -MAX_ANGLE_URAD, MAX_ANGLE_URAD)
    _within_of(where, "opening_um", squeeze.opening_um, 1, table.gripper.opening_um)
    _within_of(where, "speed_um_s", squeeze.speed_um_s, 1, limits.max_speed_um_s)
    _within_of(where, "force_mn", squeeze.force_mn, 1, limits.max_force_mn)
    _within_of(where, "clearance_um", squeeze.clearance_um, 0, 1_000_000)


def _prove_branches(where: str, node: Node, gripper: GripperSpec, calibration: Calibration) -> None:
    _within_of(where, "number of branches", len(node.branches), 1, MAX_BRANCHES)
    widest = gripper.opening_um + WIDTH_GRID_UM - 1  # intervals are rounded outwards, to the file's grid
    low, expected = 0, -1
    for number, branch in enumerate(node.branches):
        at = f"{where}, branch {number}"
        _within_of(at, "low_um", branch.low_um, low, widest)
        _within_of(at, "expected_um", branch.expected_um, max(branch.low_um, expected + 1), widest)
        _within_of(at, "high_um", branch.high_um, branch.expected_um, widest)
        _within_of(at, "probability_ppm", branch.probability_ppm, 0, PPM)
        low, expected = branch.low_um, branch.expected_um
    total = sum(branch.probability_ppm for branch in node.branches)
    if abs(total - PPM) > len(node.branches):
        raise TableError(f"{where}: the branches' probabilities sum to {total} ppm, not {PPM}")
    readable = set(count_map(node, calibration)) - {REJECT}
    for number, branch in enumerate(node.branches):
        if number not in readable:
            interval = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
            raise TableError(f"{where}, branch {number}: no encoder count means {interval}; widen it")


def _prove_leaf(where: str, leaf: Leaf, table: Table) -> None:
    _within_of(where, "x_um", leaf.x_um, -(10**9), 10**9)
    _within_of(where, "y_um", leaf.y_um, -(10**9), 10**9)
    _within_of(where, "theta_urad", leaf.theta_urad, -MAX_ANGLE_URAD, MAX_ANGLE_URAD)
    if not isinstance(leaf.covariance, tuple) or len(leaf.covariance) != 6:
        raise TableError(f"{where}: the covariance has not 6 entries")
    for value in leaf.covariance:
        _within_of(where, "covariance entry", value, -(10**9), 10**9)
    if min(leaf.covariance[0], leaf.covariance[2], leaf.covariance[5]) < 0:
        raise TableError(f"{where}: a variance is negative")
    _within_of(where, "success_ppm", leaf.success_ppm, 0, PPM)
    _within_of(where, "trials", leaf.trials, 0, 10**10)
    if type(leaf.resolved) is not bool:
        raise TableError(f"{where}: resolved is {leaf.resolved!r}, not a truth value")
    if not leaf.resolved:
        return
    _in_area(where, leaf.x_um, leaf.y_um, table.limits)
    hits = round(leaf.success_ppm / PPM * leaf.trials)
    if refuted(hits, leaf.trials, table.goal.confidence_ppm / PPM):
        raise TableError(
            f"{where}: {leaf.success_ppm / PPM:.4f} of {leaf.trials} trials met the goal, which refutes the "
            f"confidence of {table.goal.confidence_ppm / PPM:.4f}; mark it unresolved or plan deeper"
        )


def _in_area(where: str, x_um: int, y_um: int, limits: Limits) -> None:
    x_min, y_min, x_max, y_max = limits.work_area_um
    _within_of(where, "x_um", x_um, x_min, x_max)
    _within_of(where, "y_um", y_um, y_min, y_max)


def _within_of(where: str, name: str, value: int, least: int, most: int) -> None:
    """`_within` for the many fields of nodes and leaves, whose names are put together only for an error."""
    if type(value) is not int or not least <= value <= most:
        _within(f"{where}: {name}", value, least, most)


def _text(name: str, value: object) -> None:
    if not isinstance(value, str):
        raise TableError(f"{name} is {value!r}, not text")


def _integer(name: str, value: object) -> None:
    # A bool is an int to Python, and a numpy integer is one to the eye; neither is one in the file.
    if type(value) is not int:
        raise TableError(f"{name} is {value!r} of type {type(value).__name__}, not an integer")


def _within(name: str, value: int, least: int, most: int | None = None) -> None:
    _integer(name, value)
    if value < least or (most is not None and value > most):
        allowed = f"at least {least}" if most is None else f"{least}..{most}"
        raise TableError(f"{name} is {value}, allowed is {allowed}")
