"""Export of a journal as CSV: one row for each squeeze, with the outcome of the squeezed part."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from runtime.journal.lines import Entry, begins_run
from runtime.shell.errors import UsageError
from runtime.shell.files import STDOUT, writing

UNITS = {"um": ("mm", 1e3), "urad": ("rad", 1e6)}  # units in records, and in rows


def column(field: str) -> str:
    """Returns the name of the CSV column for a field of a record: `x_mm` for `x_um`."""
    name, _, unit = field.rpartition("_")
    return f"{name}_{UNITS[unit][0]}" if unit in UNITS else field


FIELDS = (
    *("time", "part", "number", "node", "x_um", "y_um", "angle_urad", "opening_um"),
    *("reading_um", "width_um", "object_flag", "current_ma", "settle_s", "target"),
)
SQUEEZE = {**{column(field): field for field in FIELDS}, "reject_reason": "reason"}
PART = ("outcome", "leaf", "hypothesis", "exit_code", "audit", "delivery")
COLUMNS = ("run", "table_sha256", *SQUEEZE, *PART)

Row = dict[str, object]


def rows(entries: Iterable[Entry]) -> Iterator[Row]:
    """Yields one row for each squeeze of a journal, in order.

    The columns named in `PART` describe how the part ended; they are None for a part without an outcome.
    """
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
    rows: Iterable[Row], path: Path, option: str, columns: Sequence[str] = COLUMNS
) -> int:
    """Writes rows as CSV to a file or standard output; returns their number.

    Args:
        rows: the rows.
        path: the file.
        option: the command-line option that named the file, for a message.
        columns: names of the columns, in order.

    Raises:
        UsageError: the file's name does not end in .csv.
        OutputError: the file cannot be written.
    """
    if path not in STDOUT and path.suffix != ".csv":
        raise UsageError(f"{option} {path}: name a file that ends in .csv")
    with writing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        number = 0
        for row in rows:
            writer.writerow(row)
            number += 1
    return number


def scaled(source: str, value: object) -> object:
    """Converts the value of a record's field, named `source`: um to mm, urad to rad, others unchanged."""
    unit = UNITS.get(source.rpartition("_")[2])
    return value / unit[1] if unit is not None and isinstance(value, int) else value
