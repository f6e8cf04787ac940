"""A journal as a table for statistics: one row a squeeze, with its part's end beside it."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from runtime.errors import ArgumentsError
from runtime.journal.replay import Entry
from runtime.shell.files import STDOUT, writing

SQUEEZE = {
    "time": "time",
    "part": "part",
    "number": "number",
    "node": "node",
    "x_mm": "x_um",
    "y_mm": "y_um",
    "angle_rad": "angle_urad",
    "opening_mm": "opening_um",
    "position_counts": "position_counts",
    "width_mm": "width_um",
    "object_flag": "object_flag",
    "current_ma": "current_ma",
    "settle_s": "settle_s",
    "target": "target",
    "reject_reason": "reason",
}
PART = {
    "outcome": "outcome",
    "leaf": "leaf",
    "hypothesis": "hypothesis",
    "exit_code": "exit_code",
    "audit": "audit",
    "delivery": "delivery",
}
COLUMNS = ("run", "table_sha256", *SQUEEZE, *PART)
SCALES = {"um": 1e3, "urad": 1e6}

Row = dict[str, object]


def rows(entries: Iterable[Entry]) -> Iterator[Row]:
    """One row for each squeeze of a journal, in order; a part without an end has none beside it."""
    run, table, part = 0, "", []
    for entry in entries:
        kind = entry["kind"]
        if kind == "squeeze":
            told = {name: scaled(source, entry.get(source)) for name, source in SQUEEZE.items()}
            part.append({"run": run, "table_sha256": table, **told, **dict.fromkeys(PART)})
        elif kind in ("header", "part", "outcome"):
            ended = {name: entry.get(source) for name, source in PART.items()} if kind == "outcome" else {}
            yield from ({**row, **ended} for row in part)
            part = []
        if kind == "header":
            run, table = run + 1, str(entry["table_sha256"])
    yield from part


def write_rows(
    found: Iterable[Row],
    path: Path,
    option: str,
    columns: Sequence[str] = COLUMNS,
    kinds: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Write rows as the suffix says, `.csv` or `.parquet`, CSV to standard output; returns their number.

    `option` named the path; `kinds` are Arrow types by column, those of the others follow from their values.
    ArgumentsError of another suffix or without pyarrow, OutputError where the file cannot be written.
    """
    if path in STDOUT or path.suffix == ".csv":
        return _write_csv(found, path, columns)
    if path.suffix == ".parquet":
        return _write_parquet(found, path, columns, kinds)
    raise ArgumentsError(f"{option} {path}: name a file that ends in .csv or .parquet")


def _write_csv(found: Iterable[Row], path: Path, columns: Sequence[str]) -> int:
    with writing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        number = 0
        for row in found:
            writer.writerow(row)
            number += 1
    return number


def _write_parquet(found: Iterable[Row], path: Path, columns: Sequence[str], kinds: Mapping[str, str]) -> int:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ArgumentsError(
            "Parquet needs pyarrow, which a cell controller does not have; "
            "install squeezetree[parquet] where you evaluate, or export to .csv"
        ) from error
    listed = list(found)
    try:
        arrays = [pyarrow.array([row[name] for row in listed], kinds.get(name)) for name in columns]
        with writing(path) as draft:
            parquet.write_table(pyarrow.table(arrays, list(columns)), draft)
    except (pyarrow.ArrowException, OverflowError) as error:  # a column of words and numbers, or of huge ones
        raise ArgumentsError(f"{path} cannot be written: {error}; name another file") from error
    return len(listed)


def scaled(source: str, value: object) -> object:
    """A record's value in mm or rad, where its name says that it is in um or urad."""
    scale = SCALES.get(source.rpartition("_")[2])
    return value / scale if scale is not None and isinstance(value, int) else value
