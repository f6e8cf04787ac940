"""Columns of numbers in CSV files with a header."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from planner.arrays import Array
from planner.errors import KeyNameError
from planner.job import documents
from runtime.shell.errors import InputError
from runtime.shell.files import writing


def read(path: Path, names: Sequence[str], defaults: Mapping[str, float] | None = None) -> Array:
    """Reads the columns `names`, then those of `defaults`, which may be missing; others are ignored.

    Raises:
        InputError: the file is missing or not text.
        KeyNameError: a column is missing.
        InputError: a value is not a finite number; names the line.
    """
    where, defaults = str(path), defaults or {}
    try:
        reader = csv.DictReader(io.StringIO(documents.read(path), newline=""))
        header = [name.strip() for name in reader.fieldnames or []]
        reader.fieldnames = header
        if missing := [name for name in names if name not in header]:
            problem = (
                f"column {', '.join(missing)} is missing; the header must name {','.join(names)}"
            )
            raise KeyNameError(problem, where=where)
        rows = []
        for row in reader:
            line = reader.line_num
            stated = [_number(row[name], name, where, line) for name in names]
            for name, default in defaults.items():
                stated.append(_number(row[name], name, where, line) if name in header else default)
            rows.append(stated)
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}", where=where) from error
    return np.array(rows, dtype=np.float64).reshape(-1, len(names) + len(defaults))


def write(
    path: Path,
    names: Sequence[str],
    numbers: Array,
    words: Sequence[str],
    further: Array | None = None,
) -> None:
    """Writes rows of numbers (n, k), a word and further numbers (n, m), under a header of all the names."""
    after = np.empty((len(numbers), 0)) if further is None else further
    with writing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row, word, rest in zip(numbers, words, after, strict=True):
            writer.writerow(
                [*(f"{value:.9g}" for value in row), word, *(f"{value:.9g}" for value in rest)]
            )


def _number(text: str | None, name: str, where: str, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"line {line}: {text!r} is not a finite number", where=where, key=name)
    return value
