"""A tree as lines of a terminal: the way of the part under way, what may follow, more if there is room."""

from collections.abc import Iterator
from math import degrees
from typing import Any, NamedTuple

from runtime.table import PPM, Branch, Table, predicted_pose
from runtime.traversal.geometry import placement


class Row(NamedTuple):
    """One line."""

    depth: int  # squeezes before it
    text: str
    target: int | None  # >= 0 a node, < 0 the leaf ~target, None for a line that stands for several
    taken: bool = False  # whether it is on the way of the part
    now: bool = False  # whether the cell is there


class Way(NamedTuple):
    """Where a part has been, from the root on, and where the cell is."""

    targets: frozenset[int]
    now: int


class Outline:
    """A table as lines."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._parents = {
            branch.target: index
            for index, node in enumerate(table.nodes)
            for branch in node.branches
        }

    def way(self, state: dict[str, Any]) -> Way:
        """The way of the part that a status (`Status.as_object`) tells of."""
        node, steps = state["node"], state["steps"]
        if node is None and steps:
            last = steps[-1]
            node = last["node"] if last["target"] is None else last["target"]
        now = node or 0
        seen = {now, *(step["node"] for step in steps), *(step["target"] for step in steps)} - {
            None
        }
        for target in tuple(seen):
            while (
                target in self._parents
            ):  # after a crash the first squeezes are not among the steps
                target = self._parents[target]
                seen.add(target)
        return Way(frozenset(seen | {0}), now)

    def rows(self, path: Way, room: int) -> list[Row]:
        """The lines of the tree: all, or the way with what is beside it, or the way alone; at most `room`."""
        table = self._table
        whole = len(table.nodes) + len(table.leaves) <= room
        opened = frozenset(range(len(table.nodes))) if whole else path.targets
        result = list(self._below(path, 0, None, 0, opened, fold=False))
        if len(result) > room:
            result = list(self._below(path, 0, None, 0, opened, fold=True))
        if len(result) > room:  # a node with more outcomes than lines: what is nearest stays
            middle = next(number for number, row in enumerate(result) if row.now)
            first = max(0, min(middle - room // 3, len(result) - room))
            result = result[first : first + room]
        return result

    def _below(
        self,
        path: Way,
        target: int,
        branch: Branch | None,
        depth: int,
        opened: frozenset[int],
        *,
        fold: bool,
    ) -> Iterator[Row]:
        taken = target in path.targets
        yield Row(depth, _text(self._table, target, branch), target, taken, target == path.now)
        if target < 0 or target not in opened:
            return
        others = 0
        for outcome in self._table.nodes[target].branches:
            if fold and target != path.now and outcome.target not in path.targets:
                others += 1
            else:
                yield from self._below(path, outcome.target, outcome, depth + 1, opened, fold=fold)
        if others:
            yield Row(depth + 1, "1 other width" if others == 1 else f"{others} other widths", None)


def _text(table: Table, target: int, branch: Branch | None) -> str:
    came = (
        ""
        if branch is None
        else f"{_widths(branch)} mm, {100 * branch.probability_ppm / PPM:.1f} %: "
    )
    if target >= 0:
        x_mm, y_mm, angle_rad = placement(table.nodes[target].squeeze)
        return f"{came}node {target}, squeeze at ({x_mm:.1f}, {y_mm:.1f}) mm, {degrees(angle_rad):.1f} deg"
    leaf = table.leaves[~target]
    if not leaf.resolved:
        return f"{came}leaf {~target}, unresolved"
    x_mm, y_mm, angle_rad = predicted_pose(leaf)
    return (
        f"{came}leaf {~target}, part at ({x_mm:.1f}, {y_mm:.1f}) mm, {degrees(angle_rad):.1f} deg"
    )


def _widths(branch: Branch) -> str:
    return f"{branch.low_um / 1000:.1f} to {branch.high_um / 1000:.1f}"
