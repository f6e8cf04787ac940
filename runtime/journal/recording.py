"""A journal as an MCAP recording for viewers of robot logs (Foxglove, Rerun): JSON messages, schemas.

Topics: `/journal` has every record as a line of a log, `/squeeze` and `/outcome` their numbers for plots,
`/hand` and `/part` where the hand squeezed and where the part was found, in the frame `table`. `foxglove.Log`
and `foxglove.PoseInFrame` are the schemas that viewers know. Each run's table is an attachment.
"""

import base64
import contextlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from runtime.errors import JournalError
from runtime.journal.export import PART, SQUEEZE, scaled
from runtime.journal.lines import RESERVED, UPTIME, Entry, begins_run
from runtime.shell.errors import UsageError
from runtime.shell.files import writing
from runtime.table import Table, TableError, loads, turned_leaf

if TYPE_CHECKING:
    from mcap.writer import Writer

INFO, WARNING, ERROR = 2, 3, 4  # levels of foxglove.Log
LIBRARY = "squeezetree"
TEXTS = frozenset({"time", "outcome", "hypothesis", "audit", "delivery", "reject_reason"})
HIDDEN = RESERVED | UPTIME | {"table_base64", "calibration_um"}  # in a line of a record

OUTCOME = {name: name for name in ("part", *PART)} | {"reject_reason": "reason"}

Schema = dict[str, object]
NUMBER, INTEGER, TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}


def _object(**properties: object) -> Schema:
    return {"type": "object", "properties": properties}


def _columns(names: Mapping[str, str]) -> Schema:
    return _object(**{name: TEXT if name in TEXTS else NUMBER for name in names})


TIME = _object(sec=INTEGER, nsec=INTEGER)
POSE = _object(
    position=_object(x=NUMBER, y=NUMBER, z=NUMBER),
    orientation=_object(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER),
)
PLACED = ("foxglove.PoseInFrame", _object(timestamp=TIME, frame_id=TEXT, pose=POSE))
# Topic -> its schema's name, and the schema (JSON Schema).
TOPICS: dict[str, tuple[str, Schema]] = {
    "/journal": (
        "foxglove.Log",
        _object(timestamp=TIME, level=INTEGER, message=TEXT, name=TEXT, file=TEXT, line=INTEGER),
    ),
    "/squeeze": ("squeezetree.Squeeze", _columns(SQUEEZE)),
    "/outcome": ("squeezetree.Outcome", _columns(OUTCOME)),
    "/hand": PLACED,
    "/part": PLACED,
}


def write(
    entries: Iterable[Entry], path: Path, journal: Path, timestamp: Callable[[str], float]
) -> int:
    """Write the records of a journal as an MCAP file; returns the number of its squeezes.

    Args:
        entries: the records.
        path: the file, or standard output.
        journal: where the records come from, for errors.
        timestamp: reads a record's time as seconds since 1970; ValueError where it is none.

    Raises:
        UsageError: the extra `mcap` is missing.
        JournalError: a record's time is no date, or a table that its digest vouches for cannot be read.
        OutputError: the file cannot be written.
    """
    with writing(path) as draft, draft.open("wb") as file:
        recording = _Recording(file, journal, timestamp)
        with contextlib.closing(recording):
            for entry in entries:
                recording.add(entry)
    return recording.squeezes


class _Recording:
    """An MCAP file being written."""

    def __init__(self, file: BinaryIO, journal: Path, timestamp: Callable[[str], float]) -> None:
        self.squeezes = 0
        self._journal, self._timestamp = journal, timestamp
        self._table: Table | None = None
        self._turn_urad = 0  # of the plan of the part under way
        self._writer = _writer(file)
        self._channels = {topic: self._channel(topic, *schema) for topic, schema in TOPICS.items()}
        self.close = self._writer.finish

    def _channel(self, topic: str, name: str, schema: Schema) -> int:
        number = self._writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        return self._writer.register_channel(topic, "json", number)

    def add(self, entry: Entry) -> None:
        """Write what one record tells."""
        moment_ns, kind = self._moment_ns(entry), entry["kind"]
        self._send("/journal", entry, moment_ns, _log_line(entry, _stamp(moment_ns)))
        if kind == "header":
            self._header(entry, moment_ns)
        elif kind in ("part", "turned"):
            self._turn_urad = int(str(entry.get("turn_urad", 0)))
        elif kind == "squeeze":
            self.squeezes += 1
            self._send("/squeeze", entry, moment_ns, _fields_of(SQUEEZE, entry))
            if all(isinstance(entry.get(name), int) for name in ("x_um", "y_um", "angle_urad")):
                self._pose(
                    "/hand", entry, moment_ns, entry["x_um"], entry["y_um"], entry["angle_urad"]
                )
        elif kind == "outcome":
            self._send("/outcome", entry, moment_ns, _fields_of(OUTCOME, entry))
            self._located(entry, moment_ns)

    def _header(self, entry: Entry, moment_ns: int) -> None:
        data = base64.b64decode(str(entry["table_base64"]))
        if self._table is not None and not begins_run(entry):
            return  # it is the run's table again
        name = f"table-{str(entry['table_sha256'])[:12]}.msgpack"
        self._writer.add_attachment(moment_ns, moment_ns, name, "application/msgpack", data)
        try:
            self._table = loads(data)
        except TableError as error:
            raise JournalError(self._journal, f"record {entry['seq']}: {error}") from error

    def _located(self, entry: Entry, moment_ns: int) -> None:
        """Where the part was found, if it was."""
        leaf = entry.get("leaf")
        if entry.get("outcome") != "leaf" or self._table is None or not isinstance(leaf, int):
            return
        if 0 <= leaf < len(self._table.leaves):
            result = turned_leaf(self._table.leaves[leaf], self._turn_urad)
            self._pose("/part", entry, moment_ns, result.x_um, result.y_um, result.theta_urad)

    def _pose(self, topic: str, entry: Entry, moment_ns: int, *pose: object) -> None:
        x_um, y_um, angle_urad = (float(str(number)) for number in pose)
        half = angle_urad / 2e6
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
        placed = {"position": {"x": x_um / 1e6, "y": y_um / 1e6, "z": 0.0}, "orientation": turn}
        self._send(
            topic,
            entry,
            moment_ns,
            {"timestamp": _stamp(moment_ns), "frame_id": "table", "pose": placed},
        )

    def _send(
        self, topic: str, entry: Entry, moment_ns: int, message: Mapping[str, object]
    ) -> None:
        data = json.dumps(message).encode()
        self._writer.add_message(
            self._channels[topic], moment_ns, data, moment_ns, sequence=int(str(entry["seq"]))
        )

    def _moment_ns(self, entry: Entry) -> int:
        try:
            moment_ns = round(self._timestamp(str(entry["time"])) * 1e6) * 1000
        except ValueError:
            moment_ns = -1
        if moment_ns < 0:
            raise JournalError(
                self._journal, f"record {entry['seq']} has a time that is no date after 1970"
            )
        return moment_ns


def _writer(file: BinaryIO) -> "Writer":
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise UsageError(
            "MCAP needs the extra mcap, which a cell controller does not have; "
            "pip install 'squeezetree[mcap]' where you evaluate, or export to .csv"
        ) from error
    writer = Writer(file)
    writer.start(library=LIBRARY)
    return writer


def _stamp(moment_ns: int) -> dict[str, int]:
    return {"sec": moment_ns // 10**9, "nsec": moment_ns % 10**9}


def _fields_of(names: Mapping[str, str], entry: Entry) -> dict[str, object]:
    """What of a record is known; viewers plot what is there."""
    record = {name: scaled(source, entry.get(source)) for name, source in names.items()}
    return {name: value for name, value in record.items() if value is not None}


def _log_line(entry: Entry, stamp: Mapping[str, int]) -> dict[str, object]:
    failed = entry["kind"] == "outcome" and entry.get("outcome") not in (
        "leaf",
        "reject",
        "unresolved",
    )
    level = ERROR if failed else WARNING if entry["kind"] == "link" or entry.get("reason") else INFO
    shown = " ".join(
        f"{name}={json.dumps(value)}" for name, value in entry.items() if name not in HIDDEN
    )
    words = f"{entry['kind']} {shown}".strip()
    record = {"timestamp": stamp, "level": level, "message": words}
    return {**record, "name": "journal", "file": "", "line": entry["seq"]}
