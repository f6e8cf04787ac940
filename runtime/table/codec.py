"""The bytes of a table: msgpack of the sections in `runtime.table.sections`; see `TABLE.md`."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import groupby, starmap
from operator import attrgetter
from typing import Any

import msgpack  # type: ignore[import-untyped]

from runtime.errors import TableError
from runtime.table.fields import FLAG, MAX_BYTES, MAX_LEAVES, TYPES
from runtime.table.model import Area, Covariance, Leaf, Node, Squeeze, Table, Tolerance
from runtime.table.sections import SECTIONS, Section, records_of

FORMAT = 12
MAGIC = "squeezetree"
BEGINNING = 16  # bytes within which a table identifies itself
FRAME_FIELDS = ("magic", "format", "digest", "payload")
NESTED = {"covariance": Covariance, "tolerance": Tolerance, "work_area_um": Area}
Records = list[
    tuple[int, Any]
]  # pairs of an index and a record, as `sections.records_of` returns them


def encode(table: Table) -> bytes:
    """Encodes a table to bytes, without validation.

    Raises:
        TableError: a value is not of its field's type.
    """
    try:
        data = _packed(table)
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        raise TableError(f"a value of the table cannot be written: {error}") from error
    if decode(data) != table:
        raise TableError(
            "its bytes decode to another table: a value is not of the type that `Table` states"
        )
    return data


def names_table(data: bytes) -> bool:
    """Whether data begins like the file of a table, of any format version; what follows is not checked."""
    return MAGIC.encode() in data[:BEGINNING]


def decode(data: bytes) -> Table:
    """Decodes a table from bytes, without validation.

    Raises:
        TableError: the bytes are not exactly the bytes that `encode` gives for a table; the message gives the
            first reason.
    """
    payload = _unpacked(_payload(data), "the payload")
    if type(payload) is not tuple or not all(type(held) is tuple and held for held in payload):
        raise TableError("the payload is no array of sections; recompile it")
    values = {held[0]: held[1:] for held in payload if type(held[0]) is str}
    names = [section.name for section in SECTIONS if not section.optional or section.name in values]
    if [held[0] for held in payload] != names:
        raise TableError(f"the sections are not {', '.join(names)}; recompile it")
    table = _table({section.name: _records(section, values) for section in SECTIONS})
    if _packed(table) != data:
        raise TableError("not in the canonical encoding of a table; recompile it")
    return table


def _payload(data: bytes) -> bytes:
    if len(data) > MAX_BYTES:
        raise TableError(f"{len(data)} bytes, allowed are {MAX_BYTES}; this is not a table")
    frame = _unpacked(data, "the file") if not data or names_table(data) else None
    if type(frame) is not tuple or len(frame) < 2 or frame[0] != MAGIC:
        raise TableError("not a squeezetree table; pass the .msgpack file plan-compile wrote")
    if type(frame[1]) is not int or frame[1] != FORMAT:
        number = frame[1] if type(frame[1]) is int else type(frame[1]).__name__
        raise TableError(f"format {number} is not read; compile the job anew")
    if len(frame) != len(FRAME_FIELDS) or not all(type(part) is bytes for part in frame[2:]):
        raise TableError(
            f"the frame is not {', '.join(FRAME_FIELDS)}; copy the file again or recompile it"
        )
    if hashlib.sha256(frame[3]).digest() != frame[2]:
        raise TableError("digest does not match its content; copy the file again or recompile it")
    payload: bytes = frame[3]
    return payload


def _unpacked(data: bytes, name: str) -> Any:
    """Decodes a msgpack value.

    Raises:
        TableError: the bytes are damaged, or hold a map, an extension or an array too long for a table.
    """
    most = {"max_array_len": MAX_LEAVES, "max_map_len": 0, "max_ext_len": 0}
    try:
        return msgpack.unpackb(data, use_list=False, **most)
    except msgpack.ExtraData:
        reason = f"bytes follow the end of {name}"
    except (MemoryError, ValueError, msgpack.UnpackException) as error:
        reason = f"{name} is damaged or cut short ({error})"
    raise TableError(f"{reason}; copy the file again or recompile it")


def _packed(table: Table) -> bytes:
    sections, records = [], records_of(table)
    for section in SECTIONS:
        if section.optional and not records[section.name]:
            continue
        columns = [] if section.owner is None else [[at for at, _ in records[section.name]]]
        for field in section.fields:
            column = map(attrgetter(field.name), (record for _, record in records[section.name]))
            columns.append([*map(int, column)] if field.type == FLAG else [*column])
        values = columns if section.row else [value for [value] in columns]
        sections.append([section.name, *values])
    payload = msgpack.packb(sections)
    return bytes(msgpack.packb([MAGIC, FORMAT, hashlib.sha256(payload).digest(), payload]))


def _records(section: Section, sections: Mapping[str, tuple[Any, ...]]) -> Records:
    """Builds the records of a section from decoded values.

    Returns:
        Pairs of the owner's index (without an owner, the record's index) and the record; empty if the section
        is absent.

    Raises:
        TableError: a field is missing, or a value is not of its field's type.
    """
    if section.name not in sections:
        return []
    values = sections[section.name]
    if len(values) != len(section.columns):
        raise TableError(
            f"{section.name} has {len(values)} fields where {len(section.columns)} belong"
        )
    columns: dict[str, tuple[Any, ...]] = {}
    for field, value in zip(section.columns, values, strict=True):
        name, kind = f"{section.name}.{field.name}", TYPES[field.type]
        column = value if section.row else (value,)
        if type(column) is not tuple:
            raise TableError(f"{name} holds {type(column).__name__} where an array belongs")
        strange = {type(value).__name__ for value in column} - {kind.__name__}
        if strange:
            raise TableError(f"{name} holds {min(strange)} where {kind.__name__} belongs")
        if field.type == FLAG and not set(column) <= {0, 1}:
            raise TableError(f"{name} holds a number that is neither 0 nor 1")
        columns[field.name] = tuple(map(bool, column)) if field.type == FLAG else column
    lengths = {len(column) for column in columns.values()}
    if len(lengths) > 1:
        raise TableError(f"{section.name} has arrays of different lengths, which are to be equal")
    owners = range(*lengths) if section.owner is None else columns.pop(section.owner.name)
    nested = _nested(columns)
    rows = zip(owners, *nested.values(), strict=True)
    return [(owner, section.record(**dict(zip(nested, row, strict=True)))) for owner, *row in rows]


def _nested(columns: Mapping[str, tuple[Any, ...]]) -> dict[str, Iterable[Any]]:
    """Combines the columns of nested records, so that one column is left for each attribute of a record.

    The columns `place.x` and `place.y`, for instance, become one column `place`, of records with x and y.
    """
    result: dict[str, Iterable[Any]] = {}
    for outer, names in groupby(columns, lambda name: name.partition(".")[0]):
        inner = {name.partition(".")[2]: columns[name] for name in names}
        if outer in NESTED:
            rows = zip(*inner.values(), strict=True)
            result[outer] = [NESTED[outer](**dict(zip(inner, row, strict=True))) for row in rows]
        else:
            result[outer] = inner[""]
    return result


def _table(records: Mapping[str, Records]) -> Table:
    branches, pushes, alternatives = (
        _by_owner(records[name]) for name in ("branches", "pushes", "alternatives")
    )
    releases, contacts = dict(records["releases"]), dict(records["contacts"])

    def node_of(at: int, squeeze: Squeeze) -> Node:
        before, after = tuple(pushes[at]), tuple(branches[at])
        return Node(squeeze, after, releases.get(at), before, **contacts.get(at, {}))

    def leaf_of(at: int, leaf: Leaf) -> Leaf:
        return leaf._replace(alternatives=tuple(alternatives[at]))

    values: dict[str, Any] = {"job": None}
    for name in ("tool", "job_digest", "job"):
        values |= dict(records[name]).get(0, {})
    for name in ("gripper", "goal", "limits", "predicted"):
        values[name] = dict(records[name])[0]
    return Table(
        **values,
        nodes=tuple(starmap(node_of, records["nodes"])),
        leaves=tuple(starmap(leaf_of, records["leaves"])),
        hypotheses=tuple(record for _, record in records["hypotheses"]),
    )


def _by_owner(records: Records) -> dict[int, list[Any]]:
    result = defaultdict[int, list[Any]](list)
    for owner, record in records:
        result[owner].append(record)
    return result
