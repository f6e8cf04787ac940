"""A journal as a table for statistics: one row a squeeze, with its part's end beside it."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from runtime.journal.lines import Entry, begins_run
from runtime.shell.errors import UsageError
from runtime.shell.files import STDOUT, writing

UNITS = {"um": ("mm", 1e3), "urad": ("rad", 1e6)}  # of records, and what rows are in instead


def column(field: str) -> str:
    """The column of a record's field: its name with the column's unit."""
    name, _, unit = field.rpartition("_")
    return f"{name}_{UNITS[unit][0]}" if unit in UNITS else field


SQUEEZE = {
    **{
        column(field): field
        for field in ("time", "part", "number", "node", "x_um", "y_um", "angle_urad")
    },
    **{column(field): field for field in ("opening_um", "reading_um", "width_um", "object_flag")},
    **{column(field): field for field in ("current_ma", "settle_s", "target")},
    "reject_reason": "reason",
}
PART = ("outcome", "leaf", "hypothesis", "exit_code", "audit", "delivery")
COLUMNS = ("run", "table_sha256", *SQUEEZE, *PART)

Row = dict[str, object]


def rows(entries: Iterable[Entry]) -> Iterator[Row]:
    """One row for each squeeze of a journal, in order; a part without an end has none beside it."""
    run, table, part = 0, "", []
    for entry in entries:
        kind = entry["kind"]
        if kind == "squeeze":
            record = {name: scaled(source, entry.get(source)) for name, source in SQUEEZE.items()}
            part.append({"run": run, "table_sha256": table, **record, **dict.fromkeys(PART)})
        elif kind in ("header", "part", "outcome"):
            ended = {name: entry.get(name) for name in PART} if kind == "outcome" else {}
            yield from ({**row, **ended} for row in part)
            part = []
        if kind == "header":
            run, table = run + begins_run(entry), str(entry["table_sha256"])
    yield from part


def write_rows(
    rows: Iterable[Row],
    path: Path,
    option: str,
    columns: Sequence[str] = COLUMNS,
    kinds: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Write rows as the suffix says, `.csv` or `.parquet`, CSV to standard output; returns their number.

    Args:
        rows: the rows.
        path: the file.
        option: that named it.
        columns: names of the columns, in order.
        kinds: Arrow types by column; those of the others follow from their values.

    Raises:
        UsageError: another suffix, or pyarrow is missing.
        OutputError: the file cannot be written.
    """
    if path in STDOUT or path.suffix == ".csv":
        return _write_csv(rows, path, columns)
    if path.suffix == ".parquet":
        return _write_parquet(rows, path, columns, kinds)
    raise UsageError(f"{option} {path}: name a file that ends in .csv or .parquet")


def _write_csv(rows: Iterable[Row], path: Path, columns: Sequence[str]) -> int:
    with writing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        number = 0
        for row in rows:
            writer.writerow(row)
            number += 1
    return number


def _write_parquet(
    rows: Iterable[Row], path: Path, columns: Sequence[str], kinds: Mapping[str, str]
) -> int:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise UsageError(
            "Parquet needs pyarrow, which a cell controller does not have; "
            "install squeezetree[parquet] where you evaluate, or export to .csv"
        ) from error
    listed = list(rows)
    try:
        arrays = [pyarrow.array([row[name] for row in listed], kinds.get(name)) for name in columns]
        with writing(path) as draft:
            parquet.write_table(pyarrow.table(arrays, list(columns)), draft)
    except (
        pyarrow.ArrowException,
        OverflowError,
    ) as error:  # a column of words and numbers, or of huge ones
        raise UsageError(f"{path} cannot be written: {error}; name another file") from error
    return len(listed)


def scaled(source: str, value: object) -> object:
    """A record's value in mm or rad, where its name says that it is in um or urad."""
    unit = UNITS.get(source.rpartition("_")[2])
    return value / unit[1] if unit is not None and isinstance(value, int) else value
