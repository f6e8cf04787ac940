"""Format 1 of the payload, which is read and no longer written; `TABLE.md` describes it.

Its writer stays, so that a file in any other form than it wrote is refused, as ever.
"""

from collections.abc import Iterable, Iterator

import msgpack  # type: ignore[import-untyped]

from runtime.errors import TableError
from runtime.table_columns import array, column, integers, rows, typed, unzigzag, values, zigzag
from runtime.table_model import (
    MAX_BRANCHES,
    MAX_LEAVES,
    MAX_NODES,
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

WIDTH_GRID_UM = 50
CLEARANCE_GRID_UM = 100
POSE_GRID_UM = 10
POSE_GRID_URAD = 1000
SHARE_GRID_PPM = 100
MAX_LINKS = MAX_NODES + MAX_LEAVES
PAYLOAD_FIELDS = (
    "tool",
    "job_digest",
    "gripper",
    "goal",
    "limits",
    "predicted",
    "placements",
    "jaws",
    "shapes",
    "nodes",
    "branches",
    "leaves",
    "job",
)


def payload_of(table: Table) -> bytes:
    """The payload that format 1 had for a table read from it.

    Raises:
        TableError: a value does not fit its field.
    """
    gripper, goal, limits, predicted = table.gripper, table.goal, table.limits, table.predicted
    placements = _distinct(node.squeeze[:3] for node in table.nodes)
    jaws = _distinct(node.squeeze[3:6] for node in table.nodes)
    fields = [
        table.tool,
        table.job_digest,
        [
            gripper.model,
            gripper.opening_um,
            gripper.finger_length_um,
            gripper.finger_width_um,
            gripper.count_open,
            gripper.count_closed,
            gripper.encoder_noise_um,
        ],
        [goal.distance_um, goal.confidence_ppm, goal.rho_um, goal.symmetry],
        [
            limits.max_depth,
            limits.max_force_mn,
            limits.max_speed_um_s,
            *limits.work_area_um,
            limits.retreat_height_um,
            limits.squeeze_height_um,
            limits.arm_speed_um_s,
        ],
        [predicted.success_ppm, predicted.trials, predicted.mean_squeezes_ppm, predicted.reject_ppm],
        column(zigzag(value) for placement in placements for value in placement),
        column(value for jaw in jaws for value in jaw),
        column(_shape(node) for node in table.nodes),
        column(value for node in table.nodes for value in _node_fields(node, placements, jaws)),
        column(value for node in table.nodes for value in _branch_fields(node)),
        column(value for leaf in table.leaves for value in _leaf_fields(leaf)),
        table.job,
    ]
    try:
        return bytes(msgpack.packb(fields))
    except (OverflowError, TypeError, ValueError) as error:
        raise TableError(f"a field of the header cannot be written: {error}") from error


def _distinct(distinct: Iterable[tuple[int, ...]]) -> dict[tuple[int, ...], int]:
    """Each distinct row and its number, in the order of first use."""
    return {row: number for number, row in enumerate(dict.fromkeys(distinct))}


def _shape(node: Node) -> int:
    """One bit a branch, first branch lowest, set where it leads to a node; a one above the last."""
    bits = sum(1 << number for number, branch in enumerate(node.branches) if branch.target >= 0)
    return bits | 1 << len(node.branches)


def _node_fields(
    node: Node, placements: dict[tuple[int, ...], int], jaws: dict[tuple[int, ...], int]
) -> Iterator[int]:
    yield placements[node.squeeze[:3]]
    yield jaws[node.squeeze[3:6]]
    yield node.squeeze.clearance_um // CLEARANCE_GRID_UM


def _branch_fields(node: Node) -> Iterator[int]:
    reached = 0
    for number, branch in enumerate(node.branches):
        yield zigzag((branch.low_um - reached) // WIDTH_GRID_UM)
        yield (branch.expected_um - branch.low_um) // WIDTH_GRID_UM
        yield (branch.high_um - branch.expected_um) // WIDTH_GRID_UM
        if number < len(node.branches) - 1:  # the last one is what is left of the whole
            yield branch.probability_ppm // SHARE_GRID_PPM
        reached = branch.high_um


def _leaf_fields(leaf: Leaf) -> Iterator[int]:
    xx, xy, yy, xt, yt, tt = leaf.covariance
    yield zigzag(leaf.x_um // POSE_GRID_UM)
    yield zigzag(leaf.y_um // POSE_GRID_UM)
    yield zigzag(leaf.theta_urad // POSE_GRID_URAD)
    yield from (xx, zigzag(xy), yy, zigzag(xt), zigzag(yt), tt)
    yield (PPM - leaf.success_ppm) // SHARE_GRID_PPM
    yield leaf.trials << 1 | leaf.resolved


def table_of(payload: object) -> Table:
    """The table in a payload, proving nothing.

    Raises:
        TableError: with the first reason found why this is none.
    """
    fields = array(payload, "the payload", len(PAYLOAD_FIELDS))
    tool, job_digest, gripper, goal, limits, predicted, *columns, job = fields
    model, *numbers = array(gripper, "gripper", 7)
    distance, confidence, rho, symmetry = integers(goal, "goal", 4)
    max_depth, force, speed, x0, y0, x1, y1, retreat, height, arm_speed = integers(limits, "limits", 10)
    placements, jaws, shapes, nodes, branches, leaves = columns
    squeezes = _squeezes(
        rows([unzigzag(value) for value in values(placements, "placements", 3 * MAX_NODES)], 3, "placements"),
        rows(values(jaws, "jaws", 3 * MAX_NODES), 3, "jaws"),
        rows(values(nodes, "nodes", 3 * MAX_NODES), 3, "nodes"),
    )
    table = Table(
        tool=typed(tool, str, "tool"),
        job_digest=typed(job_digest, bytes, "job_digest"),
        gripper=GripperSpec(typed(model, str, "gripper"), *integers(tuple(numbers), "gripper", 6)),
        goal=GoalSpec(distance, confidence, rho, symmetry),
        limits=Limits(max_depth, force, speed, (x0, y0, x1, y1), retreat, height, arm_speed),
        nodes=_nodes(
            values(shapes, "shapes", MAX_NODES), squeezes, values(branches, "branches", 4 * MAX_LINKS)
        ),
        leaves=tuple(_leaf(row) for row in rows(values(leaves, "leaves", 11 * MAX_LEAVES), 11, "leaves")),
        predicted=Prediction(*integers(predicted, "predicted", 4)),
        job=None if job is None else typed(job, str, "job"),
    )
    if payload_of(table) != msgpack.packb(payload):
        raise TableError("not in the one form this table was written in; recompile it")
    return table


def _squeezes(placements: list[list[int]], jaws: list[list[int]], nodes: list[list[int]]) -> list[Squeeze]:
    try:
        return [
            Squeeze._make((*placements[placement], *jaws[jaw], clearance * CLEARANCE_GRID_UM))
            for placement, jaw, clearance in nodes
        ]
    except IndexError:
        raise TableError("a node names a placement or a jaw setting that is not there") from None


def _nodes(shapes: list[int], squeezes: list[Squeeze], branches: list[int]) -> tuple[Node, ...]:
    if len(shapes) != len(squeezes):
        raise TableError(f"{len(shapes)} shapes for {len(squeezes)} nodes")
    numbers, records = iter(branches), list[Node]()
    next_node, next_leaf = 1, 0
    try:
        for shape, squeeze in zip(shapes, squeezes, strict=True):
            count = shape.bit_length() - 1
            if not 1 <= count <= MAX_BRANCHES:
                raise TableError(f"a node has {count} branches, allowed is 1..{MAX_BRANCHES}")
            targets = []
            for number in range(count):
                inner = shape >> number & 1
                targets.append(next_node if inner else ~next_leaf)
                next_node, next_leaf = next_node + inner, next_leaf + 1 - inner
            records.append(Node(squeeze, tuple(_branches(targets, numbers))))
    except StopIteration:
        raise TableError("the branches end before the last node's") from None
    if next(numbers, None) is not None:
        raise TableError("there are more branches than the nodes have")
    return tuple(records)


def _branches(targets: list[int], numbers: Iterator[int]) -> list[Branch]:
    records, reached, left = list[Branch](), 0, PPM
    for number, target in enumerate(targets):
        low = reached + unzigzag(next(numbers)) * WIDTH_GRID_UM
        expected = low + next(numbers) * WIDTH_GRID_UM
        reached = expected + next(numbers) * WIDTH_GRID_UM
        share = next(numbers) * SHARE_GRID_PPM if number < len(targets) - 1 else left
        left -= share
        records.append(Branch(low, expected, reached, share, target))
    return records


def _leaf(row: list[int]) -> Leaf:
    x, y, theta, xx, xy, yy, xt, yt, tt, failures, trials = row
    return Leaf(
        unzigzag(x) * POSE_GRID_UM,
        unzigzag(y) * POSE_GRID_UM,
        unzigzag(theta) * POSE_GRID_URAD,
        (xx, unzigzag(xy), yy, unzigzag(xt), unzigzag(yt), tt),
        PPM - failures * SHARE_GRID_PPM,
        trials >> 1,
        bool(trials & 1),
    )
