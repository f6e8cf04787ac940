"""Segments of many decision maps as arrays, for vectorised lookup."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import IntArray
from runtime.table import Segments

SPAN = 1 << 21  # um, wider than any gripper opens


class Lookup(NamedTuple):
    """Step functions as arrays: the segments of all rows, concatenated."""

    start: IntArray  # (s,) ascending: first width of each segment [um], plus `SPAN` for each row before
    branch: IntArray  # (s,) the branch of widths from there on, or `REJECT`

    @classmethod
    def of(cls, rows: Sequence[Segments]) -> Self:
        """The lookup of some step functions."""
        starts = [SPAN * row + np.array(each.starts_um) for row, each in enumerate(rows)]
        return cls(np.concatenate(starts), np.concatenate([each.branches for each in rows]))

    def segment(self, row: IntArray, width_um: IntArray) -> IntArray:
        """The segments (n,) of non-negative widths (n,) in rows (n,)."""
        return np.searchsorted(self.start, SPAN * row + width_um, side="right") - 1
