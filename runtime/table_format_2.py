"""The payload of a table, format 2; `TABLE.md` is the specification this follows field by field."""

import msgpack  # type: ignore[import-untyped]

from runtime import table_leaves, table_nodes
from runtime.errors import TableError
from runtime.table_columns import array, exactly, integers, packed, typed, unpacked
from runtime.table_grid import WidthGrid
from runtime.table_header import prove_gripper
from runtime.table_leaves import LeafColumns
from runtime.table_model import (
    KINDS,
    MAX_LEAVES,
    MAX_NODES,
    GoalSpec,
    GripperSpec,
    Leaf,
    Limits,
    Node,
    Prediction,
    Table,
)
from runtime.table_nodes import NodeColumns, distinct, shape_of

HEADER_FIELDS = ("tool", "job_digest", "gripper", "goal", "limits", "predicted")
COLUMNS = (
    "shapes",
    "placements",
    "jaws",
    "releases",
    "settings",
    "clearances",
    "lows",
    "spans",
    "expected",
    "shares",
    "alternatives",
    "positions",
    "angles",
    "spreads",
    "marks",
    "trials",
)
PAYLOAD_FIELDS = (*HEADER_FIELDS, *COLUMNS, "job")


def payload_of(table: Table) -> bytes:
    """The payload of a table in its canonical form; proves nothing.

    Raises:
        TableError: a value does not fit its field.
    """
    fields = [*_header(table), *map(packed, _columns_of(table)), table.job]
    try:
        return bytes(msgpack.packb(fields))
    except (OverflowError, TypeError, ValueError) as error:
        raise TableError(f"a field of the header cannot be written: {error}") from error


def table_of(payload: object) -> Table:
    """The table in a payload; proves nothing.

    Raises:
        TableError: with the first reason found why this is none.
    """
    fields = array(payload, "the payload", len(PAYLOAD_FIELDS))
    tool, job_digest, gripper, goal, limits, predicted, *columns, job = fields
    model, *numbers = array(gripper, "gripper", 7)
    distance, confidence, rho, symmetry, kind, x, y, theta, modes = integers(goal, "goal", 9)
    if not 0 <= kind < len(KINDS):
        raise TableError(f"goal has the kind {kind}, allowed are 0..{len(KINDS) - 1}")
    max_depth, force, speed, x0, y0, x1, y1, retreat, height, arm_speed = integers(limits, "limits", 10)
    spec = GripperSpec(typed(model, str, "gripper"), *integers(tuple(numbers), "gripper", 6))
    nodes, leaves = _records_of(columns, spec)
    return Table(
        tool=typed(tool, str, "tool"),
        job_digest=typed(job_digest, bytes, "job_digest"),
        gripper=spec,
        goal=GoalSpec(distance, confidence, rho, symmetry, KINDS[kind], (x, y, theta), modes),
        limits=Limits(max_depth, force, speed, (x0, y0, x1, y1), retreat, height, arm_speed),
        nodes=nodes,
        leaves=leaves,
        predicted=Prediction(*integers(predicted, "predicted", 4)),
        job=None if job is None else typed(job, str, "job"),
    )


def _header(table: Table) -> list[object]:
    gripper, goal, limits, predicted = table.gripper, table.goal, table.limits, table.predicted
    return [
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
        [
            goal.distance_um,
            goal.confidence_ppm,
            goal.rho_um,
            goal.symmetry,
            KINDS.index(goal.kind),
            *goal.tolerance,
            goal.modes,
        ],
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
    ]


def _columns_of(table: Table) -> list[list[int]]:
    """The columns in the order of `COLUMNS`."""
    of_nodes = table_nodes.columns_of(table.nodes, WidthGrid.of(table.gripper))
    of_leaves = table_leaves.columns_of(table.leaves, table.nodes)
    *tree, positions, angles = of_nodes
    return [
        *tree,
        of_leaves.alternatives,
        positions + of_leaves.positions,
        angles + of_leaves.angles,
        of_leaves.spreads,
        of_leaves.marks,
        of_leaves.trials,
    ]


def _records_of(columns: list[object], gripper: GripperSpec) -> tuple[tuple[Node, ...], tuple[Leaf, ...]]:
    """The records in the columns, none of which is unpacked further than those before it say."""
    prove_gripper(gripper)  # whose counts are the grid of the widths
    of = dict(zip(COLUMNS, columns, strict=True))
    shapes = unpacked(of["shapes"], "shapes", MAX_NODES)
    shape = shape_of(shapes)
    placements, jaws, releases, clearances = (
        exactly(of[name], name, shape.nodes) for name in ("placements", "jaws", "releases", "clearances")
    )
    lows, spans, expected = (
        exactly(of[name], name, shape.branches) for name in ("lows", "spans", "expected")
    )
    alternatives = exactly(of["alternatives"], "alternatives", shape.leaves)
    places, others = placements.count(0), sum(alternatives)
    releasing = distinct([number - 1 for number in releases if number], "releases")
    if others > MAX_LEAVES:
        raise TableError(f"the leaves have {others} alternatives, allowed are {MAX_LEAVES}")
    points = places + releasing
    positions = exactly(of["positions"], "positions", 2 * (points + shape.leaves + others))
    angles = exactly(of["angles"], "angles", places + shape.leaves + others)
    nodes = table_nodes.nodes_of(
        NodeColumns(
            shapes=shapes,
            placements=placements,
            jaws=jaws,
            releases=releases,
            settings=exactly(of["settings"], "settings", 3 * distinct(jaws, "jaws")),
            clearances=clearances,
            lows=lows,
            spans=spans,
            expected=expected,
            shares=exactly(of["shares"], "shares", shape.branches - shape.nodes),
            positions=positions[: 2 * points],
            angles=angles[:places],
        ),
        shape,
        WidthGrid.of(gripper),
    )
    leaves = table_leaves.leaves_of(
        LeafColumns(
            positions=positions[2 * points :],
            angles=angles[places:],
            alternatives=alternatives,
            spreads=exactly(of["spreads"], "spreads", 6 * shape.leaves),
            marks=exactly(of["marks"], "marks", shape.leaves),
            trials=exactly(of["trials"], "trials", shape.leaves),
        ),
        nodes,
    )
    return nodes, leaves
