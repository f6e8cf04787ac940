"""What the exported forms say in common: what follows each reading, as runs of counts and as vectors."""

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

from runtime.table import COUNTS, HELD_UM, REJECT, Calibration, Node, Table, decide, decision_map

FELT, NOT_FELT = 2, 3  # the object flag (gOBJ) of jaws that met something, and of jaws that met nothing
NODE, LEAF, UNRESOLVED, REJECTED, FAULT = range(5)  # what follows a reading, as the vectors and programs say
VECTOR = ("node", "count", "object_flag", "outcome", "index", "release_x_um", "release_y_um")


class Run(NamedTuple):
    """Neighbouring counts that a node reads as one branch; counts in no run are REJECT."""

    object_flag: int  # FELT or NOT_FELT
    first: int  # count
    last: int  # count, itself included
    branch: int  # index into the node's branches


def maps_of(table: Table) -> list[tuple[int, ...]]:
    """The decision map of each node, by the straight line from counts to widths."""
    calibration = Calibration.linear(table.gripper)
    return [decision_map(node, calibration) for node in table.nodes]


def runs_of(decided: tuple[int, ...]) -> list[Run]:
    """A decision map as runs, those with an object felt first, in the order of their counts."""
    found = []
    for flag in (FELT, NOT_FELT):
        branches = [decide(decided, count, flag == FELT) for count in range(COUNTS)]
        for branch, group in groupby(range(COUNTS), branches.__getitem__):
            counts = list(group)
            if branch != REJECT:
                found.append(Run(flag, counts[0], counts[-1], branch))
    return found


def holds(node: Node, branch: int) -> bool:
    """Whether the jaws hold the part after a branch; nobody knows after a REJECT."""
    return branch != REJECT and node.branches[branch].expected_um >= HELD_UM


def drag_of(node: Node) -> tuple[int, int]:
    """Where what a node holds is dragged before the hand opens, x and y in um; its own place: nowhere."""
    return node.release or (node.squeeze.x_um, node.squeeze.y_um)


def vectors(table: Table) -> Iterator[tuple[int, ...]]:
    """What follows every believable reading, each node, object flag and count, as rows of `VECTOR`."""
    for index, (node, decided) in enumerate(zip(table.nodes, maps_of(table), strict=True)):
        for flag in (FELT, NOT_FELT):
            for count in range(COUNTS):
                branch = decide(decided, count, flag == FELT)
                release = drag_of(node) if holds(node, branch) else node.squeeze[:2]
                yield index, count, flag, *_next(table, node, branch), *release


def _next(table: Table, node: Node, branch: int) -> tuple[int, int]:
    """Outcome and index after a branch."""
    if branch == REJECT:
        return REJECTED, -1
    target = node.branches[branch].target
    if target >= 0:
        return NODE, target
    return (LEAF if table.leaves[~target].resolved else UNRESOLVED), ~target
