"""The nodes of a table as columns of small integers, format 2, and back; see `TABLE.md`."""

from collections.abc import Hashable, Iterable, Iterator
from itertools import chain, islice
from operator import add, sub
from typing import NamedTuple, TypeVar

from runtime.errors import TableError
from runtime.table_columns import records, unzigzag, zigzag
from runtime.table_grid import MAX_SPREAD_NUMBER, SPREADS, WidthGrid, angle_number, angle_urad, spread_number
from runtime.table_model import (
    CLEARANCE_GRID_UM,
    MAX_BRANCHES,
    POSE_GRID_UM,
    PPM,
    SHARE_GRID_PPM,
    Branch,
    Node,
    Squeeze,
)

Row = TypeVar("Row", bound=Hashable)
Point = tuple[int, int]


class NodeColumns(NamedTuple):
    """The columns of the nodes; the last two are the beginnings of columns that the leaves share."""

    shapes: list[int]
    placements: list[int]
    jaws: list[int]
    releases: list[int]
    settings: list[int]
    clearances: list[int]
    lows: list[int]
    spans: list[int]
    expected: list[int]
    shares: list[int]
    positions: list[int]
    angles: list[int]


class Shape(NamedTuple):
    """How many there are of everything, from the first column alone."""

    nodes: int
    branches: int
    leaves: int
    by_node: list[int]


def shape_of(shapes: list[int]) -> Shape:
    """What the column of shapes says about the size of the tree.

    Raises:
        TableError: a node has too few or too many branches, or there are not enough nodes for the targets.
    """
    by_node = [shape.bit_length() - 1 for shape in shapes]
    if not shapes or min(by_node) < 1 or max(by_node) > MAX_BRANCHES:
        raise TableError(f"a node has no branches, or more than {MAX_BRANCHES}; or there is no node")
    inner = sum(map(int.bit_count, shapes)) - len(shapes)
    if inner != len(shapes) - 1:
        raise TableError(
            f"the shapes lead to {inner} nodes besides the root, but there are {len(shapes) - 1}"
        )
    total = sum(by_node)
    return Shape(len(shapes), total, total - inner, by_node)


def columns_of(nodes: tuple[Node, ...], grid: WidthGrid) -> NodeColumns:
    """The columns of nodes in canonical form.

    Raises:
        TableError: an interval's end is not on the grid.
    """
    squeezes = [node.squeeze for node in nodes]
    placed, placements = _numbered([squeeze[:3] for squeeze in squeezes])
    set_to, jaws = _numbered([squeeze[3:6] for squeeze in squeezes])
    dragged, releases = _numbered([node.release for node in nodes if node.release is not None])
    following = iter(dragged)
    points = chain((place[:2] for place in placements), releases)
    branches = list(chain.from_iterable(node.branches for node in nodes))
    low_ends, expected, high_ends, _, targets = zip(*branches, strict=True)
    lows, highs = list(map(grid.end_number, low_ends)), list(map(grid.end_number, high_ends))
    middles = map(_middle, lows, highs)
    return NodeColumns(
        shapes=list(_shapes(nodes, targets)),
        placements=_new_as_zero(placed),
        jaws=set_to,
        releases=[0 if node.release is None else 1 + next(following) for node in nodes],
        settings=list(chain.from_iterable(jaws)),
        clearances=[spread_number(squeeze[6] // CLEARANCE_GRID_UM) for squeeze in squeezes],
        lows=lows,
        spans=list(map(sub, highs, lows)),
        expected=list(map(zigzag, map(sub, map(grid.expected_number, expected), middles))),
        shares=[branch[3] // SHARE_GRID_PPM for node in nodes for branch in node.branches[:-1]],
        positions=[zigzag(value // POSE_GRID_UM) for point in points for value in point],
        angles=[zigzag(angle_number(place[2])) for place in placements],
    )


def nodes_of(columns: NodeColumns, shape: Shape, grid: WidthGrid) -> tuple[Node, ...]:
    """The nodes in some columns, which are as long as `shape` and `distinct` say.

    Raises:
        TableError: a number is beyond what it stands for.
    """
    angles = [angle_urad(unzigzag(value)) for value in columns.angles]
    values = [unzigzag(value) * POSE_GRID_UM for value in columns.positions]
    points = list(zip(values[::2], values[1::2], strict=True))
    places = [(x, y, angle) for (x, y), angle in zip(points, angles, strict=False)]
    releases = points[len(places) :]
    settings = columns.settings
    jaws = list(zip(settings[::3], settings[1::3], settings[2::3], strict=True))
    if max(columns.clearances) > MAX_SPREAD_NUMBER:
        raise TableError("a clearance is greater than any table's")
    squeezes = records(
        Squeeze,
        (
            (*place, *jaws[jaw], SPREADS[clearance] * CLEARANCE_GRID_UM)
            for place, jaw, clearance in zip(
                _recalled(columns.placements, places), columns.jaws, columns.clearances, strict=True
            )
        ),
    )
    if any(len(set(rows)) < len(rows) for rows in (places, jaws, releases)):
        raise TableError("a placement, a jaw setting or a release is listed twice; recompile it")
    dragged = [releases[number - 1] if number else None for number in columns.releases]
    branches = _branches_of(columns, shape, grid)
    by_node = (tuple(islice(branches, count)) for count in shape.by_node)
    return tuple(records(Node, zip(squeezes, by_node, dragged, strict=True)))


def distinct(column: list[int], name: str) -> int:
    """How many rows a column of row numbers refers to, each first use being that of the next number.

    Raises:
        TableError: a number is used before a lower one.
    """
    numbers = list(dict.fromkeys(column))
    if numbers != list(range(len(numbers))):
        raise TableError(f"the column {name} refers to rows in another order than that of their first use")
    return len(numbers)


def _branches_of(columns: NodeColumns, shape: Shape, grid: WidthGrid) -> Iterator[Branch]:
    lows, highs = columns.lows, list(map(add, columns.lows, columns.spans))
    if max(highs) >= len(grid.ends_um):
        raise TableError("an interval ends beyond the gripper's counts")
    expected = grid.expected_within([unzigzag(value) for value in columns.expected], lows, highs)
    rows = zip(
        map(grid.ends_um.__getitem__, lows),
        expected,
        map(grid.ends_um.__getitem__, highs),
        _shares_of(columns.shares, shape.by_node),
        _targets_of(columns.shapes, shape.by_node),
        strict=True,
    )
    return records(Branch, rows)


def _middle(low: int, high: int) -> int:
    """Quarters of a count midway between two ends; end n lies n - 1/2 counts from the closed end."""
    return 2 * (low + high - 1)


def _shapes(nodes: tuple[Node, ...], targets: tuple[int, ...]) -> Iterator[int]:
    """For each node a bit a branch, the first lowest, set where it leads to a node; a one above the last."""
    at = 0
    for node in nodes:
        bits = count = 0
        for target in targets[at : at + len(node.branches)]:
            bits |= (target >= 0) << count
            count += 1
        at += count
        yield bits | 1 << count


def _targets_of(shapes: list[int], by_node: list[int]) -> Iterator[int]:
    next_node, next_leaf = 1, -1
    for bits, count in zip(shapes, by_node, strict=True):
        for number in range(count):
            if bits >> number & 1:
                yield next_node
                next_node += 1
            else:
                yield next_leaf
                next_leaf -= 1


def _shares_of(shares: list[int], by_node: list[int]) -> Iterator[int]:
    """The shares in ppm; a node's last one is what is left of the whole."""
    following = iter(shares)
    for count in by_node:
        left = PPM
        for _ in range(count - 1):
            share = next(following) * SHARE_GRID_PPM
            left -= share
            yield share
        yield left


def _numbered(rows: Iterable[Row]) -> tuple[list[int], list[Row]]:
    """For each row the number of its first like, and the distinct rows in the order of first use."""
    numbers: dict[Row, int] = {}
    return [numbers.setdefault(row, len(numbers)) for row in rows], list(numbers)


def _new_as_zero(numbers: list[int]) -> list[int]:
    """Row numbers from 1 on, and 0 in place of each first: where no row comes twice, nothing but zeros."""
    seen, out = 0, []
    for number in numbers:
        out.append(0 if number == seen else number + 1)
        seen += number == seen
    return out


def _recalled(numbers: list[int], rows: list[Row]) -> Iterator[Row]:
    """The row of each number; number 0 stands for the first that was not yet seen, n for the n-th."""
    seen = 0
    for number in numbers:
        if not number:
            seen += 1
            yield rows[seen - 1]
        elif number <= seen:
            yield rows[number - 1]
        else:
            raise TableError("a node refers to a placement before its first")
