"""The parts of a history as a table for other programs: CSV, or Parquet where pyarrow is installed."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from runtime.errors import ArgumentsError
from runtime.journal.export import Row, write_csv, write_parquet
from runtime.spc.history import Part

COLUMNS = (
    *("index", "part", "time", "outcome", "leaf", "verdict", "squeezes"),
    *("residual_x_mm", "residual_y_mm", "residual_theta_rad", "alarms"),
)
# A column without a single value has its type all the same, so that the files of many reports fit together.
KINDS = {
    **dict.fromkeys(COLUMNS, "string"),
    **dict.fromkeys(("index", "part", "leaf", "squeezes"), "int64"),
    **dict.fromkeys(("residual_x_mm", "residual_y_mm", "residual_theta_rad"), "float64"),
}


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
    if path.suffix == ".csv":
        write_csv(found, path, COLUMNS)
    elif path.suffix == ".parquet":
        write_parquet(found, path, COLUMNS, KINDS)
    else:
        raise ArgumentsError(f"{path}: name a file that ends in .csv or .parquet")
