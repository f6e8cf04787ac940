"""The decision table, format 2: records, reader, writer, proof and look-up. `TABLE.md` is its specification.

The one module of the runtime that a planner needs, and may import.

```
table = canonical(table)      # numbered breadth first, on the file's grid: evaluate this one
dump(table, path)             # proves it, writes it whole or not at all
table = load(path)            # decodes it, proves it again
outcome = count_map(node, Calibration.linear(table.gripper))[count]
```
"""

import hashlib
from pathlib import Path

from runtime.errors import TableError, TableFileError
from runtime.shell import strict_json
from runtime.shell.files import writing
from runtime.table_canonical import canonical
from runtime.table_check import check
from runtime.table_codec import FRAME_FIELDS, MAX_BYTES, decode, encode
from runtime.table_format_2 import PAYLOAD_FIELDS
from runtime.table_lookup import COUNTS, REJECT, Calibration, count_map, decide, decisions
from runtime.table_model import (
    FORMAT,
    HELD_UM,
    KINDS,
    MAX_DEPTH,
    PPM,
    Branch,
    GoalSpec,
    GripperSpec,
    Leaf,
    Limits,
    Node,
    Prediction,
    Squeeze,
    Table,
)
from runtime.table_proof import prove, prove_read, refuted, wilson_upper

__all__ = [
    "COUNTS",
    "FORMAT",
    "FRAME_FIELDS",
    "HELD_UM",
    "KINDS",
    "MAX_BYTES",
    "MAX_DEPTH",
    "PAYLOAD_FIELDS",
    "PPM",
    "REJECT",
    "Branch",
    "Calibration",
    "GoalSpec",
    "GripperSpec",
    "Leaf",
    "Limits",
    "Node",
    "Prediction",
    "Squeeze",
    "Table",
    "TableError",
    "TableFileError",
    "canonical",
    "check",
    "count_map",
    "decide",
    "decisions",
    "digest",
    "dump",
    "dumps",
    "load",
    "loads",
    "prove",
    "refuted",
    "wilson_upper",
]


def dumps(table: Table) -> bytes:
    """The file of a table: its canonical form, proved.

    Raises:
        TableError: it must not be executed, and why.
    """
    settled = canonical(table)
    prove(settled)
    return encode(settled)


def loads(data: bytes) -> Table:
    """The table in a file's bytes, decoded and proved.

    Raises:
        TableError: the bytes are not exactly what `dumps` writes for a table that may be executed.
    """
    table = decode(data)
    prove_read(table)
    _check_job(table.job)
    return table


def _check_job(text: str | None) -> None:
    """Check that an embedded job is an object, as whoever looks into it expects."""
    try:
        sound = text is None or isinstance(strict_json.parse(text), dict)
    except ValueError as error:
        raise TableError(f"the embedded job is {error}; compile it again") from None
    if not sound:
        raise TableError("the embedded job is no JSON object; compile it again")


def dump(table: Table, path: Path | str) -> None:
    """Write a table's file, whole or not at all.

    Raises:
        TableError: it must not be executed, and why.
        OutputError: the file cannot be written.
    """
    data = dumps(table)
    with writing(Path(path)) as draft:
        draft.write_bytes(data)


def load(path: Path | str) -> Table:
    """Read, decode and prove a table's file.

    Raises:
        TableFileError: it is missing or unreadable.
        TableError: its content is refused; the message names the file.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise TableFileError(path, f"{error.strerror}; pass the file plan-compile wrote") from error
    try:
        return loads(data)
    except TableError as error:
        raise TableError(error.reason, path) from error


def digest(table: Table) -> bytes:
    """SHA-256 of a table's file, 32 bytes: one name for one behaviour.

    Raises:
        TableError: the table has no file, because it must not be executed.
    """
    return hashlib.sha256(dumps(table)).digest()
