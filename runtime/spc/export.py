"""The parts of a history as a table for other programs: CSV, or Parquet where pyarrow is installed."""

import csv
import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from runtime.errors import ArgumentsError
from runtime.shell.files import writing
from runtime.spc.history import Part

COLUMNS = (
    *("index", "part", "time", "outcome", "leaf", "verdict", "squeezes"),
    *("residual_x_mm", "residual_y_mm", "residual_theta_rad", "alarms"),
)

Row = dict[str, object]


def rows(parts: Iterable[Part], alarms: dict[int, list[str]]) -> Iterator[Row]:
    """One row a part; what is not known is None.

    Args:
        parts: in order.
        alarms: names of the charts that alarmed at a part, by its index.
    """
    for index, part in enumerate(parts):
        values = (
            *(index, part.number, part.time, part.outcome, part.leaf, part.verdict, len(part.squeezes)),
            *(part.residual or (None, None, None)),
            " ".join(alarms.get(index, ())),
        )
        yield dict(zip(COLUMNS, values, strict=True))


def write(found: Iterable[Row], path: Path) -> None:
    """Write rows as the suffix says: `.csv` or `.parquet`.

    Raises:
        ArgumentsError: another suffix, or pyarrow is missing.
        OutputError: the file cannot be written.
    """
    writers = {".csv": _csv, ".parquet": _parquet}
    if path.suffix not in writers:
        raise ArgumentsError(f"{path}: name a file that ends in .csv or .parquet")
    with writing(path) as draft:
        writers[path.suffix](found, draft)


def _csv(found: Iterable[Row], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(found)


def _parquet(found: Iterable[Row], path: Path) -> None:
    try:
        arrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise ArgumentsError("Parquet needs pyarrow; install squeezetree[parquet], or write .csv") from error
    kinds = {"index": "int64", "part": "int64", "leaf": "int64", "squeezes": "int64"}
    fields = [(name, arrow.field(name, _kind(arrow, name, kinds))) for name in COLUMNS]
    schema = arrow.schema([field for _, field in fields])
    parquet.write_table(arrow.Table.from_pylist(list(found), schema=schema), path)


def _kind(arrow: object, name: str, kinds: dict[str, str]) -> object:
    kind = kinds.get(name, "float64" if name.startswith("residual") else "string")
    return getattr(arrow, kind)()
