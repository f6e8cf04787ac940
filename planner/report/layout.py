"""Where the panels of a plan stand: a tidy tree, the root on top (Reingold and Tilford, 1981).

Every depth has two slots, the panels and the gap below them, so that what stands in the gap (the branches of
a node, the text of a leaf) is kept apart too.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from runtime.table import Table


class Sizes(NamedTuple):
    """Half widths, and the distance between neighbours."""

    panel: float  # half the width of a panel
    label: float  # half the width of what is written at a branch
    text: float  # half the width of what is written below a leaf
    margin: float  # least distance between two of these


class Spot(NamedTuple):
    """A panel's place: the middle along its row, and its depth in the tree from 0."""

    x: float
    depth: int


class Layout(NamedTuple):
    """The places of all panels."""

    nodes: tuple[Spot, ...]  # one a node of the table
    leaves: tuple[Spot, ...]  # one a leaf
    rows: int  # how many there are
    width: float  # of the whole, from 0


@dataclass(slots=True)
class _Subtree:
    """A target of the table with its children, places relative to its own middle."""

    target: int
    contour: dict[int, tuple[float, float]]
    children: list[tuple[float, "_Subtree"]] = field(default_factory=list)


def tidy(table: Table, sizes: Sizes) -> Layout:
    """Places the panels of a table."""
    root = _subtree(table, 0, 0, sizes)
    left = min(low for low, _ in root.contour.values())
    right = max(high for _, high in root.contour.values())
    spots: dict[int, Spot] = {}
    waiting = [(root, Spot(-left, 0))]
    while waiting:
        subtree, spot = waiting.pop()
        spots[subtree.target] = spot
        waiting.extend((child, Spot(spot.x + x, spot.depth + 1)) for x, child in subtree.children)
    return Layout(
        nodes=tuple(spots[index] for index in range(len(table.nodes))),
        leaves=tuple(spots[~index] for index in range(len(table.leaves))),
        rows=1 + max(spot.depth for spot in spots.values()),
        width=right - left,
    )


def _subtree(table: Table, target: int, depth: int, sizes: Sizes) -> _Subtree:
    panel = {2 * depth: (-sizes.panel, sizes.panel)}
    if target < 0:
        return _Subtree(target, panel | {2 * depth + 1: (-sizes.text, sizes.text)})
    children = [_subtree(table, branch.target, depth + 1, sizes) for branch in table.nodes[target].branches]
    xs, merged = _row(children, sizes.margin)
    middle = 0.5 * (xs[0] + xs[-1])
    contour = {slot: (low - middle, high - middle) for slot, (low, high) in merged.items()}
    first, last = xs[0] - middle, xs[-1] - middle
    contour |= panel | {2 * depth + 1: (first - sizes.label, last + sizes.label)}
    return _Subtree(target, contour, [(x - middle, child) for x, child in zip(xs, children, strict=True)])


def _row(subtrees: list[_Subtree], margin: float) -> tuple[list[float], dict[int, tuple[float, float]]]:
    """Places of subtrees beside each other, as close as they may be, and their common contour."""
    xs: list[float] = []
    merged: dict[int, tuple[float, float]] = {}
    for subtree in subtrees:
        shared = merged.keys() & subtree.contour.keys()
        x = max((merged[slot][1] - subtree.contour[slot][0] + margin for slot in shared), default=0.0)
        xs.append(x)
        for slot, (low, high) in subtree.contour.items():
            held = merged.get(slot, (low + x, high + x))
            merged[slot] = (min(held[0], low + x), max(held[1], high + x))
    return xs, merged
