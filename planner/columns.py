"""Columns of numbers in CSV files with a header."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from planner.arrays import Array
from planner.errors import KeyNameError
from planner.job import documents
from runtime.shell.errors import InputError
from runtime.shell.files import writing


def read(
    path: Path, names: Sequence[str], defaults: Mapping[str, float] | None = None
) -> dict[str, Array]:
    """Reads columns of numbers from a CSV file.

    Args:
        path: the file.
        names: the columns that the file must have.
        defaults: the columns that the file may lack; each with the number that fills a missing column.

    Returns:
        The columns (n,) by name: first the names of `names`, then the names of `defaults`.

    Raises:
        KeyNameError: a column of `names` is missing.
        InputError: the file is missing or not CSV, a column is named twice, a row has more fields than the
            header, or a value is not a finite number.
    """
    where, defaults = str(path), defaults or {}
    try:
        reader = csv.DictReader(io.StringIO(documents.read(path), newline=""))
        header = [name.strip() for name in reader.fieldnames or []]
        reader.fieldnames = header
        if missing := [name for name in names if name not in header]:
            remedy = f"the header must name {','.join(names)}"
            raise KeyNameError(f"column {', '.join(missing)} is missing; {remedy}", where=where)
        if len(set(header)) < len(header):
            raise InputError("the header names a column twice; name each once", where=where)
        rows = []
        for row in reader:
            line = reader.line_num
            if None in row:
                remedy = "write decimal points, and a comma between two fields only"
                raise InputError(
                    f"line {line}: has more fields than the header; {remedy}", where=where
                )
            stated = [_number(row[name], name, where, line) for name in names]
            for name, default in defaults.items():
                stated.append(_number(row[name], name, where, line) if name in header else default)
            rows.append(stated)
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}", where=where) from error
    wanted = (*names, *defaults)
    table = np.array(rows, dtype=np.float64).reshape(-1, len(wanted))
    return dict(zip(wanted, table.T.copy(), strict=True))


Table: TypeAlias = dict[str, Array | list[str]]
"""Columns of numbers or words by their names."""


def named(names: Sequence[str], rows: Array) -> Table:
    """Converts rows (n, k) to k columns, keyed by `names`."""
    return dict(zip(names, rows.T, strict=True))


def write(path: Path, table: Table) -> None:
    """Writes columns to a CSV file, under a header of their names."""
    texts = (
        [f"{value:.9g}" for value in column] if isinstance(column, np.ndarray) else column
        for column in table.values()
    )
    with writing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(zip(*texts, strict=True))


def _number(text: str | None, name: str, where: str, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"line {line}: {text!r} is not a finite number", where=where, key=name)
    return value
