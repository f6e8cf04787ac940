"""The decision table: its records, file, validation, look-up, goal and times. `TABLE.md` specifies the file.

Planner and camera import from this package, not from its modules.

```
dump(table, path)             # validates it, writes it whole or not at all
table, data, digest = load(path)
decided = decision_map(node, table.gripper)
outcome = decide(decided, width_um, felt)
```
"""

import hashlib
from pathlib import Path
from typing import NamedTuple

from drivers.ports import GripperProfile
from runtime.errors import TableError
from runtime.shell.files import quoted, writing
from runtime.table.codec import decode, encode, names_table
from runtime.table.embedded import job_of
from runtime.table.evidence import refuted, successes_of, wilson_interval
from runtime.table.fields import MAX_BRANCHES, MAX_BYTES
from runtime.table.geometry import Pose2, placement, turned_pose
from runtime.table.goal import (
    distance,
    error_mm,
    hypotheses_of,
    meets,
    poses_of,
    predicted_pose,
    residual,
    threshold,
)
from runtime.table.grip import not_held
from runtime.table.grippers import (
    DEFAULT_MODEL,
    PROFILES,
    doubt_um,
    profile_of,
    same_model,
    selectable,
)
from runtime.table.lookup import Calibration, DecisionMap, Segments, decide, decision_map, misfits
from runtime.table.model import (
    HELD_UM,
    PPM,
    REJECT,
    Area,
    Branch,
    Covariance,
    GoalSpec,
    GripperSpec,
    Hypothesis,
    Leaf,
    LeafPose,
    Limits,
    Node,
    Place,
    Prediction,
    Push,
    Squeeze,
    Table,
    Tolerance,
)
from runtime.table.schedule import Schedule, Squeezed, close_alike
from runtime.table.takt import figures as takt_figures
from runtime.table.takt import text as takt_text
from runtime.table.timing import (
    ABOVE_MM,
    CLEAR_MM,
    LEAD_MM,
    Phases,
    Timing,
    Visit,
    phases_of,
    time_of,
    trapezoid_s,
)
from runtime.table.turning import may_turn, same_from_every_side, turned, turned_leaf
from runtime.table.validation import validate


class TableFile(NamedTuple):
    """A validated table, the bytes of its file, and their SHA-256 in hexadecimal."""

    table: Table
    data: bytes
    digest: str


def dumps(table: Table) -> bytes:
    """Validates a table and returns the bytes of its file, from which `loads` restores it.

    Raises:
        TableError: the table must not be executed; the message says why.
    """
    data = encode(table)
    validate(table)
    return data


def loads(data: bytes) -> Table:
    """Decodes and validates the table in the bytes of a file.

    Raises:
        TableError: the bytes are not exactly the bytes that `dumps` writes for a valid table.
    """
    table = decode(data)
    validate(table)
    return table


def dump(table: Table, path: Path | str) -> None:
    """Validates a table and writes its file, whole or not at all.

    Raises:
        TableError: the table must not be executed; the message says why.
        OutputError: the file cannot be written.
    """
    data = dumps(table)
    with writing(Path(path)) as draft:
        draft.write_bytes(data)


def load(path: Path | str) -> TableFile:
    """Reads, decodes and validates a table's file.

    Raises:
        TableError: the file is missing, unreadable or no valid table; the message names the file.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise TableError(
            f"table {path}: {error.strerror}; pass the file plan-compile wrote"
        ) from error
    try:
        return TableFile(loads(data), data, hashlib.sha256(data).hexdigest())
    except TableError as error:
        command = f"squeezetree plan {quoted(path)} -o {quoted(path.with_suffix('.msgpack'))}"
        hint = f"; it is a job file: {command} makes its table" if path.suffix == ".toml" else ""
        raise TableError(f"table {path.name}: {error}{hint}") from error
