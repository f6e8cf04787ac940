"""What stays the same in all squeezes of one part, whatever the plan believed: traits of part and cell.

Traits are a structured array with a row for each particle or part. A further trait is a further field, and
what it does belongs where it acts: in `Simulator.sample`, in `belief.transition` or in both.
"""

from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, BoolArray, IntArray
from planner.part.outline import offsets, reach

WAVES = 3  # of the deviations along a contour, the longest once around
FRESH = -1.0
SHAPES = 2 + 2 * WAVES

TRAITS = np.dtype(
    [
        ("hypothesis", np.int64),  # which of the job's parts it is
        ("friction", np.float64),  # between fingers and part; `FRESH`: drawn anew for every squeeze
        (
            "share",
            np.float64,
        ),  # what the upper finger makes of the closing, more than its share in the job
        ("surface", np.int64),  # which of the simulator's limit surfaces
        ("dof", np.int64),  # degrees of freedom of that surface's scatter; 0: those of the job
        ("deviation", np.float64, SHAPES),  # of the outline, for each of `shapes` [mm]
        ("encoder_mm", np.float64),  # added to every width before it is read
        ("gain", np.float64),  # of the encoder: so much of a width is added to it
        (
            "across_mm",
            np.float64,
        ),  # how far the hand stands off its place, along the closing direction
    ]
)
Traits: TypeAlias = NDArray[np.void]


def as_planned(n: int) -> Traits:
    """Traits (n,) of a world without anything off."""
    traits = np.zeros(n, TRAITS)
    traits["friction"] = FRESH
    return traits


def joined(pieces: Iterable[Traits]) -> Traits:
    """The traits of several groups of parts, one after the other.

    Joined as bytes: numpy would compare the fields of each group first, which takes longer than the copy.
    """
    raw = [np.ascontiguousarray(piece).view(np.uint8) for piece in pieces]
    return np.concatenate(raw).view(TRAITS)


def ordinary(traits: Traits) -> BoolArray:
    """Where (n,) nothing changes how a part moves in the hand."""
    moved = (
        (traits["hypothesis"] != 0)
        | (traits["share"] != 0.0)
        | (traits["surface"] != 0)
        | (traits["dof"] != 0)
        | traits["deviation"].any(axis=1)
    )
    return np.asarray((traits["friction"] == FRESH) & ~moved)


def by_hypothesis(traits: Traits) -> Iterator[tuple[int, slice | IntArray]]:
    """Each hypothesis that occurs, and its rows; all at once where there is but the first."""
    which = traits["hypothesis"]
    if not which.any():
        yield 0, slice(None)
        return
    for k in np.unique(which).tolist():
        yield k, np.flatnonzero(which == k)


def hypothesis_alone(traits: Traits) -> Traits:
    """Traits (n,) of the same parts in a world without anything off."""
    same = as_planned(len(traits))
    same["hypothesis"] = traits["hypothesis"]
    return same


def with_hypothesis(poses: Array, traits: Traits) -> Array:
    """Poses (n, 3) and, where another than the first hypothesis occurs, that as a fourth column."""
    which = traits["hypothesis"]
    return np.column_stack([poses, which]) if which.any() else poses


def shapes(outline: Array) -> Array:
    """How vertices (N, 2) move for 1 mm of each deviation, (SHAPES, N, 2).

    All edges outwards; larger by scale, 1 mm at the farthest vertex; waves along the contour, two of each.
    """
    outwards = offsets(outline)
    lengths = np.hypot(*(np.roll(outline, -1, axis=0) - outline).T)
    along = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(lengths[:-1])]) / lengths.sum()
    waves = [
        wave(k * along)[:, None] * outwards
        for k in range(1, WAVES + 1)
        for wave in (np.cos, np.sin)
    ]
    return np.stack([outwards, outline / reach(outline), *waves])
