"""Traits: latent parameters of part and cell that stay the same in all squeezes of a part.

Traits are a structured array with a row for each particle or part. A new trait is a new field; its effect
belongs in `Simulator.sample`, in `belief.transition` or in both.
"""

from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, BoolArray, IntArray
from planner.part.outline import offsets, reach

WAVES = 3  # number of wavelengths of outline errors; the longest wave goes once around the contour
FRESH = -1.0  # value of "friction" with which every squeeze draws a new coefficient
SHAPES = 2 + 2 * WAVES  # number of deviations of an outline, see `shapes`

TRAITS = np.dtype(
    [
        ("hypothesis", np.int64),  # number of the part's hypothesis
        ("friction", np.float64),  # coefficient; `FRESH`: drawn anew for every squeeze
        ("share", np.float64),  # added to the upper finger's share of the closing
        ("surface", np.int64),  # number of the limit surface in the simulator
        ("dof", np.int64),  # degrees of freedom of the surface's scatter; 0: as the job states
        ("deviation", np.float64, SHAPES),  # one deviation for each of `shapes` [mm]
        ("encoder_mm", np.float64),  # added to every width before it is read
        ("gain", np.float64),  # error of the encoder in proportion to the width
        ("across_mm", np.float64),  # offset of the hand along the closing direction
    ]
)
Traits: TypeAlias = NDArray[np.void]


def as_planned(n: int) -> Traits:
    """Traits (n,) of parts in a cell where everything is as planned."""
    traits = np.zeros(n, TRAITS)
    traits["friction"] = FRESH
    return traits


def joined(pieces: Iterable[Traits]) -> Traits:
    """Concatenates the traits of several groups of parts.

    It copies the arrays as bytes: numpy would first compare their fields, which takes longer than the copy.
    """
    raw = [np.ascontiguousarray(piece).view(np.uint8) for piece in pieces]
    return np.concatenate(raw).view(TRAITS)


def ordinary(traits: Traits) -> BoolArray:
    """Mask (n,) of the parts of the first hypothesis whose mechanics are as planned."""
    moved = (
        (traits["hypothesis"] != 0)
        | (traits["share"] != 0.0)
        | (traits["surface"] != 0)
        | (traits["dof"] != 0)
        | traits["deviation"].any(axis=1)
    )
    return np.asarray((traits["friction"] == FRESH) & ~moved)


def by_hypothesis(traits: Traits) -> Iterator[tuple[int, slice | IntArray]]:
    """Yields the number of each hypothesis that occurs, and its rows in `traits` (n,).

    The rows are a slice of all rows if only the first hypothesis occurs, else their indices.
    """
    which = traits["hypothesis"]
    if not which.any():
        yield 0, slice(None)
        return
    for k in np.unique(which).tolist():
        yield k, np.flatnonzero(which == k)


def with_hypothesis(poses: Array, traits: Traits) -> Array:
    """Poses (n, 3), with the hypothesis as a fourth column unless all parts have the first one."""
    which = traits["hypothesis"]
    return np.column_stack([poses, which]) if which.any() else poses


def shapes(outline: Array) -> Array:
    """How the vertices (N, 2) of an outline move for 1 mm of each deviation of the outline: (SHAPES, N, 2).

    The deviations are an offset of all edges outwards; a scaling, measured at the farthest vertex; and waves
    along the contour, two of each wavelength.
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
