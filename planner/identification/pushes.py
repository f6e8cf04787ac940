"""Measured wrench-twist pairs, from a robot's push log or a table of one's own.

A table is CSV with the columns `COLUMNS` and optionally `weight`: the wrench on the part and the twist it
answered with, about the origin of the part's frame (its area centroid) and along its axes. Only the direction
of a twist matters.
"""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.errors import ValueRangeError
from planner.identification import push_log
from planner.identification.push_log import finite
from planner.job import documents

COLUMNS = ("fx_n", "fy_n", "tau_n_mm", "vx_mm", "vy_mm", "omega_rad")
WEIGHT = "weight"


class Pairs(NamedTuple):
    """Measured wrenches and the twists that answered them, in the part's frame."""

    wrenches: Array  # (K, 3) fx N, fy N, tau N mm
    twists: Array  # (K, 3) vx mm, vy mm, omega rad, of any magnitude but 0
    weights: Array  # (K,) positive


def load(path: str | Path) -> Pairs:
    """Read pairs from a push log, or from a table if the name ends in .csv.

    Raises:
        InputFileError: missing, unreadable or not text.
        ValueRangeError: the content is not as described above; names the line.
    """
    where = str(path)
    text = documents.read(path)
    if where.lower().endswith(".csv"):
        return parse_table(text, where)
    wrenches, twists = push_log.pairs(push_log.parse(text, where), where)
    return Pairs(wrenches, twists, np.ones(len(twists)))


def join(parts: list[Pairs]) -> Pairs:
    """Return the pairs of several files as one."""
    return Pairs(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def parse_table(text: str, where: str = "table") -> Pairs:
    """Read a table of pairs.

    Raises:
        ValueRangeError: a column or all rows missing, or a value that is not a number, not positive (a
            weight) or all zero (a wrench, a twist); names the line.
    """
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = header
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        problem = f"line 1: column {', '.join(missing)} is missing; the header must name {','.join(COLUMNS)}"
        raise ValueRangeError(problem, where=where)
    wanted = [*COLUMNS, WEIGHT] if WEIGHT in header else list(COLUMNS)
    rows = []
    for record in reader:
        place = f"line {reader.line_num}"
        row = [finite(record[name], f"{place}: {name}", where) for name in wanted]
        if not any(row[:3]) or not any(row[3:6]) or (len(row) > 6 and row[6] <= 0.0):
            problem = f"{place}: a wrench or twist is zero, or a weight not positive; drop the line"
            raise ValueRangeError(problem, where=where)
        rows.append(row)
    if not rows:
        raise ValueRangeError("line 2: holds no pair; add lines of numbers", where=where)
    table = np.array(rows)
    return Pairs(table[:, :3], table[:, 3:6], table[:, 6] if len(wanted) > 6 else np.ones(len(table)))
