"""The leaves of a table as columns of small integers, format 2, and back; see `TABLE.md`."""

from collections.abc import Iterator
from itertools import chain, islice
from typing import NamedTuple

from runtime.errors import TableError
from runtime.table_columns import records, unzigzag, zigzag
from runtime.table_grid import (
    MAX_SPREAD_NUMBER,
    SPREADS,
    angle_number,
    angle_urad,
    correlation_number,
    covariance,
    failures,
    spread_number,
    success_ppm,
)
from runtime.table_model import POSE_GRID_UM, Leaf, Node

Pose = tuple[int, int, int]
Moments = tuple[int, int, int, int, int, int]


class LeafColumns(NamedTuple):
    """The columns of the leaves; the first two are the ends of columns that begin with the nodes' own."""

    positions: list[int]
    angles: list[int]
    alternatives: list[int]
    spreads: list[int]
    marks: list[int]
    trials: list[int]


def columns_of(leaves: tuple[Leaf, ...], nodes: tuple[Node, ...]) -> LeafColumns:
    """The columns of leaves in canonical form, which are numbered in the order of the nodes' branches."""
    places = [leaf[:3] for leaf in leaves]
    others = [other for leaf in leaves for other in leaf.alternatives]
    abouts = _hands(nodes)
    abouts += [place for leaf, place in zip(leaves, places, strict=True) for _ in leaf.alternatives]
    positions, angles = list[int](), list[int]()
    for (x, y, theta), (x0, y0, theta0) in zip(places + others, abouts, strict=True):
        positions += zigzag((x - x0) // POSE_GRID_UM), zigzag((y - y0) // POSE_GRID_UM)
        angles.append(zigzag(angle_number(theta) - angle_number(theta0)))
    return LeafColumns(
        positions=positions,
        angles=angles,
        alternatives=[len(leaf.alternatives) for leaf in leaves],
        spreads=list(chain.from_iterable(_spread_numbers(leaf.covariance) for leaf in leaves)),
        marks=[failures(leaf.success_ppm, leaf.trials) << 1 | (not leaf.resolved) for leaf in leaves],
        trials=[leaf.trials for leaf in leaves],
    )


def leaves_of(columns: LeafColumns, nodes: tuple[Node, ...]) -> tuple[Leaf, ...]:
    """The leaves in some columns, one for each branch that leads to a leaf.

    Raises:
        TableError: a number is beyond any table's.
    """
    xs, ys = ([unzigzag(value) * POSE_GRID_UM for value in columns.positions[axis::2]] for axis in range(2))
    turns = [unzigzag(value) for value in columns.angles]
    hands = _hands(nodes)
    counts = columns.alternatives
    places = _poses_about(hands, xs, ys, turns)
    abouts = [place for place, count in zip(places, counts, strict=True) for _ in range(count)]
    others = iter(_poses_about(abouts, xs[len(hands) :], ys[len(hands) :], turns[len(hands) :]))
    alternatives = [tuple(islice(others, count)) if count else () for count in counts]
    covariances = map(_covariance, *(columns.spreads[field::6] for field in range(6)))
    rows = (
        (*place, moments, success_ppm(mark >> 1, trials), trials, not mark & 1, further)
        for place, moments, mark, trials, further in zip(
            places, covariances, columns.marks, columns.trials, alternatives, strict=True
        )
    )
    return tuple(records(Leaf, rows))


def _hands(nodes: tuple[Node, ...]) -> list[Pose]:
    """For each leaf, in their order, the placement of the squeeze before it."""
    return [node.squeeze[:3] for node in nodes for branch in node.branches if branch.target < 0]


def _poses_about(abouts: list[Pose], xs: list[int], ys: list[int], turns: list[int]) -> list[Pose]:
    """So many poses, from how far each is from another one on the grid."""
    return [
        (x0 + x, y0 + y, angle_urad(angle_number(theta0) + turn))
        for (x0, y0, theta0), x, y, turn in zip(abouts, xs, ys, turns, strict=False)
    ]


def _spread_numbers(moments: Moments) -> Iterator[int]:
    """The numbers of the three variances, then of the three covariances."""
    xx, xy, yy, xt, yt, tt = moments
    yield from map(spread_number, (xx, yy, tt))
    for both, one, other in ((xy, xx, yy), (xt, xx, tt), (yt, yy, tt)):
        yield zigzag(correlation_number(both, one, other)) if both else 0


def _covariance(xx: int, yy: int, tt: int, xy: int, xt: int, yt: int) -> Moments:
    """The inverse of `_spread_numbers`."""
    if xx > MAX_SPREAD_NUMBER or yy > MAX_SPREAD_NUMBER or tt > MAX_SPREAD_NUMBER:
        raise TableError("a leaf's variance is greater than any table's")
    x, y, t = SPREADS[xx], SPREADS[yy], SPREADS[tt]
    if not (xy or xt or yt):
        return x, 0, y, 0, 0, t
    return x, _read(xy, x, y), y, _read(xt, x, t), _read(yt, y, t), t


def _read(number: int, one: int, other: int) -> int:
    eighths = unzigzag(number)
    both = covariance(eighths, one, other)
    if correlation_number(both, one, other) != eighths:
        raise TableError("a leaf's correlation is not in the one form it is written in; recompile it")
    return both
