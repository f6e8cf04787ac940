"""The proof of the values of nodes and leaves one by one: integers, each in its range.

Columns are looked at as a whole; which value is wrong is looked for only once one is.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from runtime.errors import TableError
from runtime.table_header import integer, within
from runtime.table_model import (
    MAX_ALTERNATIVES,
    MAX_ANGLE_URAD,
    MAX_BRANCHES,
    MAX_COVARIANCE,
    MAX_LEAVES,
    MAX_NODES,
    PPM,
    Branch,
    Squeeze,
    Table,
)

FAR_UM = 10**9
MAX_TRIALS = 10**10
ROUNDED_UP_UM = 49  # format 1 rounded an interval's upper end up, beyond a fully open gripper
POSE_NAMES = ("x_um", "y_um", "theta_urad")
MOMENT_NAMES = (
    "variance xx",
    "covariance xy",
    "variance yy",
    "covariance xt",
    "covariance yt",
    "variance tt",
)
Bounds = tuple[int, int]


class Rows(NamedTuple):
    """Rows of integers that mean the same: what each column is called, its bounds, and where a row is."""

    rows: Sequence[tuple[int, ...]]
    names: Sequence[str]
    bounds: Sequence[Bounds]
    where: Callable[[int], str]


def prove_types(table: Table) -> None:
    """Check that the nodes and leaves are made of integers; what was read from a file always is.

    Raises:
        TableError: naming the first node, branch or leaf that is not.
    """
    for index, leaf in enumerate(table.leaves):
        if type(leaf.resolved) is not bool:
            raise TableError(f"leaf {index}: resolved is {leaf.resolved!r}, not a truth value")
    for rows, names, _, where in _all_rows(table):
        for index, row in enumerate(rows):
            if not isinstance(row, tuple) or len(row) != len(names):
                raise TableError(f"{where(index)} is {row!r}, not {', '.join(names)}")
            for name, value in zip(names, row, strict=True):
                if type(value) is not int:
                    integer(f"{where(index)}: {name}", value)


def prove_values(table: Table) -> None:
    """Check that each value of the nodes and leaves is in its range; all are integers.

    Raises:
        TableError: naming the first node, branch or leaf with a value that is not.
    """
    within("number of nodes", len(table.nodes), 1, MAX_NODES)
    within("number of leaves", len(table.leaves), 1, MAX_LEAVES)
    for index, node in enumerate(table.nodes):
        if not 1 <= len(node.branches) <= MAX_BRANCHES:
            within(f"node {index}: number of branches", len(node.branches), 1, MAX_BRANCHES)
    for index, leaf in enumerate(table.leaves):
        if leaf.alternatives:
            within(f"leaf {index}: number of alternatives", len(leaf.alternatives), 0, MAX_ALTERNATIVES)
    within("number of alternatives", sum(len(leaf.alternatives) for leaf in table.leaves), 0, MAX_LEAVES)
    for rows, names, bounds, where in _all_rows(table):
        for name, (least, most), column in zip(names, bounds, zip(*rows, strict=True), strict=False):
            if min(column) < least or max(column) > most:
                for index, value in enumerate(column):
                    within(f"{where(index)}: {name}", value, least, most)


def _all_rows(table: Table) -> Iterator[Rows]:
    nodes, gripper, limits = table.nodes, table.gripper, table.limits
    x_min, y_min, x_max, y_max = limits.work_area_um
    area, turn = ((x_min, x_max), (y_min, y_max)), (-MAX_ANGLE_URAD, MAX_ANGLE_URAD)
    jaws = ((1, gripper.opening_um), (1, limits.max_speed_um_s), (1, limits.max_force_mn), (0, 1_000_000))
    squeezes = [node.squeeze for node in nodes]
    yield Rows(squeezes, Squeeze._fields, (*area, turn, *jaws), lambda at: f"node {at}: squeeze")
    dragging = [(index, node.release) for index, node in enumerate(nodes) if node.release is not None]
    releases = [release for _, release in dragging]
    yield Rows(releases, POSE_NAMES[:2], area, lambda at: f"node {dragging[at][0]}: release")
    widths = (0, gripper.opening_um + ROUNDED_UP_UM)
    targets = (-len(table.leaves), len(nodes) - 1)
    branches = [branch for node in nodes for branch in node.branches]
    bounds = (widths, widths, widths, (0, PPM), targets)
    yield Rows(branches, Branch._fields, bounds, lambda at: _branch_at(table, at))
    yield from _leaf_rows(table)


def _leaf_rows(table: Table) -> Iterator[Rows]:
    leaves, far = table.leaves, (-FAR_UM, FAR_UM)
    pose = (far, far, (-MAX_ANGLE_URAD, MAX_ANGLE_URAD))
    numbers = [(*leaf[:3], *leaf[4:6]) for leaf in leaves]
    counted = ((0, PPM), (0, MAX_TRIALS))
    names = (*POSE_NAMES, "success_ppm", "trials")
    yield Rows(numbers, names, (*pose, *counted), lambda at: f"leaf {at}")
    variance, shared = (0, MAX_COVARIANCE), (-MAX_COVARIANCE, MAX_COVARIANCE)
    moments = (variance, shared, variance, shared, shared, variance)
    yield Rows([leaf.covariance for leaf in leaves], MOMENT_NAMES, moments, lambda at: f"leaf {at}")
    others = [(index, other) for index, leaf in enumerate(leaves) for other in leaf.alternatives]
    yield Rows(
        [other for _, other in others], POSE_NAMES, pose, lambda at: f"leaf {others[at][0]}: alternative"
    )


def _branch_at(table: Table, at: int) -> str:
    """Where the branch of a number is, counted through all nodes."""
    for index, node in enumerate(table.nodes):
        if at < len(node.branches):
            return f"node {index}, branch {at}"
        at -= len(node.branches)
    raise IndexError(at)
