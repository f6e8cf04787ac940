"""The decision table: records, look-up, goal, bytes, proof, fit. `TABLE.md` is its specification.

The one package of the runtime that planner and camera need, and may import.

```
dump(table, path)             # proves it, writes it whole or not at all
table, data, digest = load(path)
decided = decision_map(node, Calibration.linear(table.gripper))
outcome = decide(decided, count, felt)
```
"""

import hashlib
from pathlib import Path
from typing import NamedTuple

from runtime.errors import TableError, TableFileError
from runtime.shell.files import quoted, writing
from runtime.table.codec import MAX_BYTES, decode, encode, names_table
from runtime.table.evidence import refuted, successes_of, wilson_interval
from runtime.table.goal import (
    Pose2,
    distance,
    error_mm,
    hypotheses_of,
    meets,
    poses_of,
    predicted_pose,
    residual,
    threshold,
)
from runtime.table.grippers import PROFILES, Profile, profile_of
from runtime.table.lookup import (
    COUNTS,
    REJECT,
    Calibration,
    by_count,
    decide,
    decision_map,
    misfits,
)
from runtime.table.model import (
    HELD_UM,
    KINDS,
    MAX_BRANCHES,
    PPM,
    UNDETECTED_UM,
    Branch,
    GoalSpec,
    GripperSpec,
    Hypothesis,
    Leaf,
    Limits,
    Node,
    Prediction,
    Push,
    Squeeze,
    Table,
)
from runtime.table.proof import job_of, prove
from runtime.table.schedule import Schedule, Squeezed, Stand, close_alike
from runtime.table.takt import figures as takt_figures
from runtime.table.takt import text as takt_text
from runtime.table.timing import (
    ABOVE_MM,
    ARM_ACCELERATION_MM_S2,
    CLEAR_MM,
    LEAD_MM,
    Phases,
    Timing,
    Visit,
    phases_of,
    time_of,
    trapezoid_s,
)

__all__ = [
    "COUNTS",
    "HELD_UM",
    "KINDS",
    "MAX_BRANCHES",
    "PPM",
    "PROFILES",
    "REJECT",
    "UNDETECTED_UM",
]
__all__ += ["Calibration", "GoalSpec", "GripperSpec", "Hypothesis", "Limits", "Pose2", "Prediction"]
__all__ += [
    "Branch",
    "Leaf",
    "Node",
    "Profile",
    "Push",
    "Squeeze",
    "Table",
    "TableError",
    "TableFile",
]
__all__ += [
    "TableFileError",
    "by_count",
    "decide",
    "decision_map",
    "dump",
    "dumps",
    "job_of",
    "load",
]
__all__ += [
    "distance",
    "error_mm",
    "hypotheses_of",
    "loads",
    "meets",
    "misfits",
    "names_table",
    "poses_of",
]
__all__ += ["phases_of", "takt_figures", "takt_text", "time_of", "trapezoid_s"]
__all__ += ["ABOVE_MM", "ARM_ACCELERATION_MM_S2", "LEAD_MM"]
__all__ += ["CLEAR_MM", "Phases", "Schedule", "Squeezed", "Stand", "Timing", "Visit", "close_alike"]
__all__ += [
    "predicted_pose",
    "profile_of",
    "refuted",
    "residual",
    "successes_of",
    "threshold",
    "wilson_interval",
]


class TableFile(NamedTuple):
    """A table, decoded and proved, the bytes of its file, and their SHA-256 as `sha256sum` tells it."""

    table: Table
    data: bytes
    digest: str


def dumps(table: Table) -> bytes:
    """The bytes of a table's file; `loads` gives the same table back.

    Raises:
        TableError: it must not be executed, and why.
    """
    data = encode(table)
    prove(table)
    return data


def loads(data: bytes) -> Table:
    """The table in a file's bytes, decoded and proved.

    Raises:
        TableError: the bytes are not exactly what `dumps` writes for a table that may be executed.
    """
    table = decode(data)
    prove(table)
    return table


def dump(table: Table, path: Path | str) -> None:
    """Write a table's file, whole or not at all.

    Raises:
        TableError: it must not be executed, and why.
        OutputError: the file cannot be written.
    """
    data = dumps(table)
    with writing(Path(path)) as draft:
        draft.write_bytes(data)


def load(path: Path | str) -> TableFile:
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
        return TableFile(loads(data), data, hashlib.sha256(data).hexdigest())
    except TableError as error:
        hint = (
            f"; it is a job file: squeezetree plan {quoted(path)} -o {quoted(path.with_suffix('.msgpack'))} "
            "makes its table"
        )
        raise TableError(
            f"table {path.name}: {error}{hint if path.suffix == '.toml' else ''}"
        ) from error
