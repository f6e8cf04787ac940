"""The proof of a table: every reason not to execute it, looked for at every write and every read."""

import hashlib
from itertools import chain
from math import cos, sin
from typing import Any

from runtime.errors import TableError
from runtime.shell import strict_json
from runtime.shell.plain_text import LONGEST, is_plain, unprintable
from runtime.table.agreement import prove_agreement
from runtime.table.codec import COLUMNS, rows_of
from runtime.table.evidence import prove_figures, refuted, successes_of
from runtime.table.lookup import Calibration, decision_map
from runtime.table.model import (
    MAX_ALTERNATIVES,
    MAX_BRANCHES,
    MAX_DEPTH,
    MAX_HYPOTHESES,
    MAX_LEAVES,
    MAX_NODES,
    MAX_PUSHES,
    PPM,
    GoalSpec,
    GripperSpec,
    Leaf,
    Limits,
    Node,
    Table,
)

FAR = 10**9
MAX_ANGLE_URAD = 3_142_000
MAX_TRIALS = 10**10
MAX_MODES = 64
MAX_SYMMETRY = 1000


def prove(table: Table) -> None:
    """Check that a table, made of integers as a decoded one is, may be executed.

    Raises:
        TableError: naming the first node, branch, leaf or field that is wrong.
    """
    job = _prove_header(table)
    _within("number of nodes", len(table.nodes), 1, MAX_NODES)
    _within("number of leaves", len(table.leaves), 1, MAX_LEAVES)
    _prove_hypotheses(table)
    _prove_values(table)
    _prove_tree(table)
    calibration = Calibration.linear(table.gripper)
    for index, node in enumerate(table.nodes):
        _prove_pushes(index, node, table.limits)
        if node.contact_um is not None:
            widest_um = max(branch.expected_um for branch in node.branches)
            _within(
                f"node {index}: contact_um", node.contact_um, widest_um, node.squeeze.opening_um - 1
            )
        total, below = 0, -1
        for number, branch in enumerate(node.branches):
            if not (
                branch.low_um <= branch.expected_um <= branch.high_um and below < branch.expected_um
            ):
                at = f"node {index}, branch {number}: expected_um"
                _within(at, branch.expected_um, max(branch.low_um, below + 1), branch.high_um)
            total, below = total + branch.probability_ppm, branch.expected_um
        if abs(total - PPM) > len(node.branches):
            raise TableError(
                f"node {index}: the branches' probabilities sum to {total} ppm, not {PPM}"
            )
        unread = set(range(len(node.branches))).difference(decision_map(node, calibration))
        if unread:
            number = min(unread)
            low, high = node.branches[number].low_um / 1000, node.branches[number].high_um / 1000
            message = f"{low:.2f}..{high:.2f} mm"
            raise TableError(
                f"node {index}, branch {number}: no encoder count means {message}; widen it"
            )
    for index, leaf in enumerate(table.leaves):
        _within(f"leaf {index}: error_median_um", leaf.error_median_um, 0, leaf.error_p95_um)
        if leaf.resolved:
            _prove_resolved(index, leaf, table)
    prove_figures(table)
    if job is not None:
        prove_agreement(table, job)


def job_of(table: Table) -> dict[str, Any] | None:
    """The job that a table carries, None where it was stripped.

    Raises:
        TableError: the text is not that of the job's digest, or no JSON object that can be read.
    """
    if table.job is None:
        return None
    try:
        if hashlib.sha256(table.job.encode()).digest() != table.job_digest:
            raise TableError(
                "the embedded job is not the one the table was made from; recompile it"
            )
        job = strict_json.parse(table.job)
    except ValueError as error:
        raise TableError(f"the embedded job is {error}; recompile it") from None
    if not isinstance(job, dict):
        raise TableError("the embedded job is no JSON object; recompile it")
    if (text := unprintable(job)) is not None:
        raise TableError(f"the embedded job holds {text}, which does not print; recompile it")
    return job


def _within(name: str, value: int, least: int, most: int = FAR) -> None:
    if not least <= value <= most:
        raise TableError(f"{name} is {value}, allowed is {least}..{most}")


def _prove_header(table: Table) -> dict[str, Any] | None:
    """Check texts, job, gripper, goal, limits and figures of the whole; returns the job."""
    _within("bytes of job_digest", len(table.job_digest), 32, 32)
    texts = {"tool": table.tool, "gripper_model": table.gripper.model}
    texts |= {
        f"hypothesis {index}: name": hypothesis.name
        for index, hypothesis in enumerate(table.hypotheses)
    }
    for name, text in texts.items():
        if not is_plain(text):
            raise TableError(
                f"{name} is no line of 1 to {LONGEST} printable characters; recompile it"
            )
    job = job_of(table)
    _prove_gripper(table.gripper)
    _prove_goal(table.goal)
    _prove_limits(table.limits)
    predicted = table.predicted
    _within("predicted.success_ppm", predicted.success_ppm, 0, PPM)
    _within("predicted.trials", predicted.trials, 0, MAX_TRIALS)
    _within("predicted.mean_squeezes_ppm", predicted.mean_squeezes_ppm, 0, MAX_DEPTH * PPM)
    _within("predicted.reject_ppm", predicted.reject_ppm, 0, PPM)
    _within("predicted.error_p95_um", predicted.error_p95_um, 0)
    _within("predicted.error_median_um", predicted.error_median_um, 0, predicted.error_p95_um)
    return job


def _prove_gripper(gripper: GripperSpec) -> None:
    for name in ("opening_um", "finger_length_um", "finger_width_um"):
        _within(f"gripper.{name}", getattr(gripper, name), 1, 1_000_000)
    _within("gripper.count_closed", gripper.count_closed, 1, 255)
    _within("gripper.count_open", gripper.count_open, 0, gripper.count_closed - 1)
    _within("gripper.encoder_noise_um", gripper.encoder_noise_um, 0, gripper.opening_um)


def _prove_goal(goal: GoalSpec) -> None:
    measured = goal.kind in ("pose", "modes")
    _within("goal.distance_um", goal.distance_um, int(measured))
    _within("goal.confidence_ppm", goal.confidence_ppm, 0, PPM)
    _within("goal.rho_um", goal.rho_um, 0)
    _within("goal.symmetry", goal.symmetry, 1, MAX_SYMMETRY)
    _within("goal.modes", goal.modes, 1, MAX_MODES)
    shifts, turns = goal.kind == "tolerances", goal.kind in ("tolerances", "orientation")
    for name, value, needed in zip("xyt", goal.tolerance, (shifts, shifts, turns), strict=True):
        _within(f"goal.tolerance {name}", value, int(needed))


def _prove_hypotheses(table: Table) -> None:
    """Check the parts that may lie there, and that leaves name them; of one part nothing is said."""
    if not table.hypotheses:
        if table.goal.kind == "identity":
            raise TableError("the goal asks which part it is, of which there is one; recompile it")
        return
    number = len(table.hypotheses)
    _within("number of hypotheses", number, 2, MAX_HYPOTHESES)
    if len({hypothesis.name for hypothesis in table.hypotheses}) < number:
        raise TableError("two hypotheses have one name; recompile it")
    for index, hypothesis in enumerate(table.hypotheses):
        _within(f"hypothesis {index}: share_ppm", hypothesis.share_ppm, 0, PPM)
        _within(f"hypothesis {index}: rho_um", hypothesis.rho_um, 0)
        _within(f"hypothesis {index}: symmetry", hypothesis.symmetry, 1, MAX_SYMMETRY)
    if table.hypotheses[0][2:] != (table.goal.rho_um, table.goal.symmetry):
        raise TableError("rho and symmetry of the goal are not the first hypothesis'; recompile it")
    for index, leaf in enumerate(table.leaves):
        for which in (leaf.hypothesis, *leaf.other_hypotheses):
            _within(f"leaf {index}: hypothesis", which, 0, number - 1)


def _prove_limits(limits: Limits) -> None:
    _within("limits.max_depth", limits.max_depth, 1, MAX_DEPTH)
    for name in ("max_force_mn", "max_speed_um_s", "arm_speed_um_s"):
        _within(f"limits.{name}", getattr(limits, name), 1)
    x_min, y_min, x_max, y_max = limits.work_area_um
    _within("limits.work_area_um x min", x_min, -FAR)
    _within("limits.work_area_um y min", y_min, -FAR)
    _within("limits.work_area_um x max", x_max, x_min + 1)
    _within("limits.work_area_um y max", y_max, y_min + 1)
    _within("limits.squeeze_height_um", limits.squeeze_height_um, -FAR)
    _within("limits.retreat_height_um", limits.retreat_height_um, limits.squeeze_height_um + 1)


def _bounds(table: Table) -> dict[str, tuple[tuple[int, int], ...]]:
    """The least and the greatest value of each column, in the order of `COLUMNS`."""
    gripper, limits = table.gripper, table.limits
    x_min, y_min, x_max, y_max = limits.work_area_um
    area, turn, share = (
        ((x_min, x_max), (y_min, y_max)),
        (-MAX_ANGLE_URAD, MAX_ANGLE_URAD),
        (0, PPM),
    )
    width, pose = (0, gripper.opening_um), ((-FAR, FAR), (-FAR, FAR), turn)
    jaws = (
        (1, gripper.opening_um),
        (1, limits.max_speed_um_s),
        (1, limits.max_force_mn),
        (0, 1_000_000),
    )
    variance, shared = (0, FAR), (-FAR, FAR)
    moments = (variance, shared, variance, shared, shared, variance)
    targets = (-len(table.leaves), len(table.nodes) - 1)
    return {
        "node": (*area, turn, *jaws, *area, (1, MAX_BRANCHES)),
        "branch": (width, width, width, share, targets),
        "leaf": (
            *pose,
            *moments,
            share,
            (0, MAX_TRIALS),
            (0, 1),
            (0, MAX_ALTERNATIVES),
            (0, FAR),
            (0, FAR),
        ),
        "alternative": pose,
        "push": (*area, turn, width, (1, 1_000_000), (1, limits.arm_speed_um_s)),
    }


def _prove_values(table: Table) -> None:
    """Check the range of every column; which value is wrong is looked for only once one is."""
    bounds = _bounds(table)
    for kind, rows in rows_of(table).items():
        columns = zip(*rows, strict=True)
        for name, column, (least, most) in zip(
            COLUMNS[kind], columns, bounds[kind], strict=bool(rows)
        ):
            if min(column) < least or max(column) > most:
                index = next(at for at, value in enumerate(column) if not least <= value <= most)
                _within(f"{_place(table, kind, index)}: {name}", column[index], least, most)


def _place(table: Table, kind: str, index: int) -> str:
    """Where the record of a kind is, told by the node or leaf that it belongs to."""
    owners = {
        "branch": ("node", [len(node.branches) for node in table.nodes]),
        "alternative": ("leaf", [len(leaf.alternatives) for leaf in table.leaves]),
        "push": ("node", [len(node.pushes) for node in table.nodes]),
    }
    if kind not in owners:
        return f"{kind} {index}"
    owner, sizes = owners[kind]
    of_each = chain.from_iterable(
        (f"{owner} {at}, {kind} {k}" for k in range(n)) for at, n in enumerate(sizes)
    )
    return list(of_each)[index]


def _prove_tree(table: Table) -> None:
    """Check that nodes and leaves are numbered breadth first, so that each is reached exactly once."""
    depths, leaves = [1], 0
    for index, node in enumerate(table.nodes):
        if index >= len(depths):
            raise TableError(f"node {index} is never reached")
        if depths[index] > table.limits.max_depth:
            raise TableError(
                f"node {index} is deeper than limits.max_depth = {table.limits.max_depth}"
            )
        for number, branch in enumerate(node.branches):
            following = len(depths) if branch.target >= 0 else ~leaves
            if branch.target != following:
                message = f"target is {branch.target}, where breadth first it is {following}"
                raise TableError(f"node {index}, branch {number}: {message}")
            if branch.target >= 0:
                depths.append(depths[index] + 1)
            else:
                leaves += 1
    if leaves < len(table.leaves):
        raise TableError(f"leaf {leaves} is never reached")


def _prove_pushes(index: int, node: Node, limits: Limits) -> None:
    """Check that there are not too many, and that each ends within the work area, too."""
    _within(f"node {index}: number of pushes", len(node.pushes), 0, MAX_PUSHES)
    x_min, y_min, x_max, y_max = limits.work_area_um
    for number, push in enumerate(node.pushes):
        turn, at = push.angle_urad / 1e6, f"node {index}, push {number}: "
        _within(f"{at}x_um of its end", round(push.x_um + push.length_um * cos(turn)), x_min, x_max)
        _within(f"{at}y_um of its end", round(push.y_um + push.length_um * sin(turn)), y_min, y_max)


def _prove_resolved(index: int, leaf: Leaf, table: Table) -> None:
    goal, confidence = table.goal, table.goal.confidence_ppm / PPM
    x_min, y_min, x_max, y_max = table.limits.work_area_um
    for x, y, _ in (leaf[:3], *leaf.alternatives):
        _within(f"leaf {index}: x_um", x, x_min, x_max)
        _within(f"leaf {index}: y_um", y, y_min, y_max)
    poses = 1 + len(leaf.alternatives)
    if poses > (goal.modes if goal.kind == "modes" else 1):
        raise TableError(
            f"leaf {index}: {poses} poses are more than the goal leaves open; mark it unresolved"
        )
    below = leaf.success_ppm < goal.confidence_ppm
    if below and refuted(successes_of(leaf), leaf.trials, confidence, len(table.leaves)):
        raise TableError(
            f"leaf {index}: {leaf.success_ppm / PPM:.4f} of {leaf.trials} trials met the goal, which refutes "
            f"the confidence of {confidence:.4f}; mark it unresolved or plan deeper"
        )
