"""Validation of a table, at every write and every read: refuses a table that must not be executed."""

from collections import Counter
from math import cos, sin
from operator import attrgetter
from typing import Any

from runtime.errors import TableError
from runtime.shell.plain_text import is_plain
from runtime.table.agreement import validate_agreement
from runtime.table.embedded import job_of
from runtime.table.evidence import refuted, successes_of, validate_figures
from runtime.table.fields import FAR, LINE, Field
from runtime.table.lookup import Calibration, decision_map, unread
from runtime.table.model import KINDS, PPM, GoalSpec, GripperSpec, Leaf, Limits, Node, Table
from runtime.table.sections import SECTIONS, Section, records_of


def validate(table: Table) -> None:
    """Checks that a table may be executed; its values must already be of the right types.

    Raises:
        TableError: the table is refused; the message names the first wrong node, branch, leaf or field.
    """
    records = records_of(table)
    for section in SECTIONS:
        _validate_numbers(section, records)
        for field in section.fields:
            _validate_field(table, section, field, records[section.name])
    job = job_of(table)
    _validate_goal(table.goal)
    limits = table.limits
    _within("limits.retreat_height_um", limits.retreat_height_um, limits.squeeze_height_um + 1)
    _validate_hypotheses(table)
    _validate_tree(table)
    calibration = Calibration(table.gripper.profile)
    for index, node in enumerate(table.nodes):
        _validate_motions(index, node, limits)
        _validate_branches(index, node, table.gripper, calibration)
    for index, leaf in enumerate(table.leaves):
        _within(f"leaf {index}: error_median_um", leaf.error_median_um, 0, leaf.error_p95_um)
        if leaf.resolved:
            _validate_resolved(index, leaf, table)
    validate_figures(table)
    if job is not None:
        validate_agreement(table, job)


def _within(name: str, value: int, least: int, most: int = FAR) -> None:
    if not least <= value <= most:
        raise TableError(f"{name} is {value}, allowed is {least}..{most}")


def _validate_numbers(section: Section, records: dict[str, list[tuple[int, Any]]]) -> None:
    """Checks how many records a section has or, if nodes or leaves own them, how many each has."""
    if section.owner is None:
        if section.row and not (section.optional and not records[section.name]):
            number = len(records[section.name])
            _within(f"number of {section.name}", number, section.least, section.most)
        return
    held = Counter(owner for owner, _ in records[section.name])
    owners = {"node": "nodes", "leaf": "leaves"}[section.owner.name]
    for index in range(len(records[owners])):
        where = f"{section.owner.name} {index}: number of {section.name}"
        _within(where, held[index], section.least, section.most)


def _validate_field(
    table: Table, section: Section, field: Field, records: list[tuple[int, Any]]
) -> None:
    """Checks the range of a field in all records of its section; the message names the first wrong record."""
    values = [*map(attrgetter(field.name), (record for _, record in records))]
    sizes = values if field.type in ("int", "flag") else [*map(len, values)]
    least, most = field.bounds(table)
    if sizes and not least <= min(sizes) <= max(sizes) <= most:
        index = next(at for at, size in enumerate(sizes) if not least <= size <= most)
        length = "" if sizes is values else "length of "
        _within(f"{length}{_place(section, field, records, index)}", sizes[index], least, most)
    if field.type == LINE and not all(map(is_plain, values)):
        index = next(at for at, value in enumerate(values) if not is_plain(value))
        raise TableError(
            f"{_place(section, field, records, index)} is no line of {least} to {most} printable "
            "characters; recompile it"
        )


def _place(section: Section, field: Field, records: list[tuple[int, Any]], index: int) -> str:
    """Text by which an error names a field of one record: "node 3, branch 1: low_um" for instance."""
    if not section.row:
        return field.name if field.name == section.name else f"{section.name}.{field.name}"
    owner, place = records[index][0], ""
    if section.owner is not None:
        place = f"{section.owner.name} {owner}, "
        index -= next(at for at, (other, _) in enumerate(records) if other == owner)
    return f"{place}{section.row} {index}: {field.name}"


def _validate_goal(goal: GoalSpec) -> None:
    if goal.kind not in KINDS:
        raise TableError(f"goal.kind is {goal.kind}, allowed are {', '.join(KINDS)}")
    if goal.kind in ("pose", "modes"):
        _within("goal.distance_um", goal.distance_um, 1)
    if goal.kind == "tolerances":
        _within("goal.tolerance.x_um", goal.tolerance.x_um, 1)
        _within("goal.tolerance.y_um", goal.tolerance.y_um, 1)
    if goal.kind in ("tolerances", "orientation"):
        _within("goal.tolerance.theta_urad", goal.tolerance.theta_urad, 1)


def _validate_hypotheses(table: Table) -> None:
    """Checks the hypotheses against the goal, and that the leaves refer to existing hypotheses."""
    goal, hypotheses = table.goal, table.hypotheses
    if not hypotheses and (goal.kind == "identity" or not goal.identify):
        raise TableError("the goal asks which part it is, but there is only one; recompile it")
    if len({part.name for part in hypotheses}) < len(hypotheses):
        raise TableError("two hypotheses have one name; recompile it")
    if hypotheses and hypotheses[0][2:] != (goal.rho_um, goal.symmetry):
        raise TableError("hypothesis 0 has another rho or symmetry than the goal; recompile it")
    for index, leaf in enumerate(table.leaves):
        for pose in leaf.poses:
            _within(f"leaf {index}: hypothesis", pose.hypothesis, 0, max(len(hypotheses), 1) - 1)


def _validate_tree(table: Table) -> None:
    """Checks that nodes and leaves are numbered breadth first, so that each is reached exactly once."""
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
    if len(depths) > len(table.nodes):
        raise TableError(f"node {len(table.nodes)} is missing")
    if leaves != len(table.leaves):
        what = "is missing" if leaves > len(table.leaves) else "is never reached"
        raise TableError(f"leaf {min(leaves, len(table.leaves))} {what}")


def _validate_motions(index: int, node: Node, limits: Limits) -> None:
    """Checks that each push ends within the work area, and that a release is not at the squeeze's place."""
    area = limits.work_area_um
    for number, push in enumerate(node.pushes):
        turn, at = push.angle_urad / 1e6, f"node {index}, push {number}: "
        x_um, y_um = push.x_um + push.length_um * cos(turn), push.y_um + push.length_um * sin(turn)
        _within(f"{at}x_um of its end", round(x_um), area.x_min, area.x_max)
        _within(f"{at}y_um of its end", round(y_um), area.y_min, area.y_max)
    if node.release == node.squeeze.place:
        raise TableError(f"node {index}: its release is where it squeezes; leave it out")


def _validate_branches(
    index: int, node: Node, gripper: GripperSpec, calibration: Calibration
) -> None:
    """Checks a node's branches: their order, the sum of probabilities, and that some reading selects each."""
    total, below = 0, -1
    for number, branch in enumerate(node.branches):
        at, least_um = f"node {index}, branch {number}", max(branch.low_um, below + 1)
        _within(f"{at}: expected_um", branch.expected_um, least_um, branch.high_um)
        total, below = total + branch.probability_ppm, branch.expected_um
    if abs(total - PPM) > len(node.branches):
        raise TableError(f"node {index}: the branches' probabilities sum to {total} ppm, not {PPM}")
    if node.contact_um is not None:
        _within(f"node {index}: contact_um", node.contact_um, below, node.squeeze.opening_um - 1)
    missing = unread(decision_map(node, gripper), calibration, len(node.branches))
    if missing:
        number = missing[0]
        low, high = node.branches[number].low_um / 1000, node.branches[number].high_um / 1000
        raise TableError(
            f"node {index}, branch {number}: no reading means {low:.2f}..{high:.2f} mm; widen it"
        )


def _validate_resolved(index: int, leaf: Leaf, table: Table) -> None:
    goal, area = table.goal, table.limits.work_area_um
    for pose in leaf.poses:
        _within(f"leaf {index}: x_um", pose.x_um, area.x_min, area.x_max)
        _within(f"leaf {index}: y_um", pose.y_um, area.y_min, area.y_max)
    if len(leaf.poses) > (goal.modes if goal.kind == "modes" else 1):
        raise TableError(
            f"leaf {index}: {len(leaf.poses)} poses are more than the goal allows; "
            "mark it unresolved"
        )
    below, confidence = leaf.success_ppm < goal.confidence_ppm, goal.confidence_ppm / PPM
    if below and refuted(successes_of(leaf), leaf.trials, confidence, len(table.leaves)):
        raise TableError(
            f"leaf {index}: {leaf.success_ppm / PPM:.4f} of {leaf.trials} trials met the goal, which refutes "
            f"the confidence of {confidence:.4f}; mark it unresolved or plan deeper"
        )
