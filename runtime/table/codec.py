"""The bytes of a table, formats 3 to 10: arrays of integers, one a field. `TABLE.md` is their specification.

The number is 3, and 1 more with fields for several hypotheses (`SEVERAL_FIELDS`), 2 more with fields for
pushes (`PUSH_FIELDS`), 4 more with the widths of first contact (`CONTACT_FIELDS`), in this order.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, replace
from itertools import islice
from typing import TypeVar

import msgpack  # type: ignore[import-untyped]

from runtime.errors import TableError
from runtime.table.model import (
    KINDS,
    MAX_ALTERNATIVES,
    MAX_BRANCHES,
    MAX_LEAVES,
    MAX_PUSHES,
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

FORMAT = 3
SEVERAL = 4
PUSHING = 5
PUSHING_SEVERAL = 6
CONTACTS = 7
MAGIC = "squeezetree"
BEGINNING = 16  # bytes within which a table names itself
MAX_BYTES = 2 << 20
FRAME_FIELDS = ("magic", "format", "digest", "payload")
HEADER_FIELDS = ("tool", "job_digest", "gripper_model", "gripper", "goal", "limits", "predicted")
POSE = Leaf._fields[:3]
# The columns of integers: one a field of each kind of record.
COLUMNS = {
    "node": (*Squeeze._fields, "release_x_um", "release_y_um", "branches"),
    "branch": Branch._fields,
    "leaf": (*POSE, "xx", "xy", "yy", "xt", "yt", "tt", *Leaf._fields[4:10]),
    "alternative": POSE,
    "push": Push._fields,
}
PAYLOAD_FIELDS = (
    *HEADER_FIELDS,
    *(f"{kind}_{field}" for kind, fields in COLUMNS.items() if kind != "push" for field in fields),
    "job",
)

SEVERAL_FIELDS = (
    "identify",
    *(f"hypothesis_{field}" for field in Hypothesis._fields),
    "leaf_hypothesis",
    "alternative_hypothesis",
)
PUSH_FIELDS = ("node_pushes", *(f"push_{field}" for field in Push._fields))
CONTACT_FIELDS = ("node_contact_um",)
MORE_FIELDS = {SEVERAL: SEVERAL_FIELDS, PUSHING: PUSH_FIELDS, CONTACTS: CONTACT_FIELDS}
FORMATS = range(FORMAT, FORMAT + sum(more - FORMAT for more in MORE_FIELDS) + 1)

Kind = TypeVar("Kind")
Row = tuple[int, ...]


def encode(table: Table) -> bytes:
    """The bytes of a table; proves nothing.

    Raises:
        TableError: a value is not of the kind that its field holds.
    """
    try:
        number = format_of(table)
        writers: dict[int, Callable[[Table], Sequence[object]]] = {
            SEVERAL: _several,
            PUSHING: _pushes,
            CONTACTS: _contacts,
        }
        more = [value for part in _parts_in(number) for value in writers[part](table)]
        payload = bytes(msgpack.packb([*_header(table), *_columns(table), table.job, *more]))
        frame = bytes(msgpack.packb([MAGIC, number, hashlib.sha256(payload).digest(), payload]))
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        raise TableError(f"a value of the table cannot be written: {error}") from error
    if decode(frame) != table:
        raise TableError(
            "the table does not come back from its bytes: a value of it is not as `Table` says"
        )
    return frame


def names_table(data: bytes) -> bool:
    """Whether bytes begin as those of a table do, of whatever format and however damaged."""
    return MAGIC.encode() in data[:BEGINNING]


def decode(data: bytes) -> Table:
    """The table in some bytes, if `encode` gives these very bytes for it; proves nothing.

    Raises:
        TableError: with the first reason found why these bytes are not a table.
    """
    if len(data) > MAX_BYTES:
        raise TableError(f"{len(data)} bytes, allowed are {MAX_BYTES}; this is not a table")
    named = not data or names_table(data)
    frame = _unpacked(data, "the file") if named else None
    if not isinstance(frame, tuple) or len(frame) < 2 or frame[0] != MAGIC:
        raise TableError("not a squeezetree table; pass the .msgpack file plan-compile wrote")
    if type(frame[1]) is not int or frame[1] not in FORMATS:
        number = frame[1] if type(frame[1]) is int else type(frame[1]).__name__
        raise TableError(
            f"format {number} is not readable; this runtime reads {FORMATS[0]} to {FORMATS[-1]}, recompile it"
        )
    if len(frame) != len(FRAME_FIELDS) or not all(type(part) is bytes for part in frame[2:]):
        raise TableError(
            f"the frame is not {', '.join(FRAME_FIELDS)}; copy the file again or recompile it"
        )
    if hashlib.sha256(frame[3]).digest() != frame[2]:
        raise TableError("digest does not match its content; copy the file again or recompile it")
    payload = _unpacked(frame[3], "the payload")
    if msgpack.packb(frame) != data or msgpack.packb(payload) != frame[3]:
        raise TableError("not in the one encoding a table has; recompile it")
    names = fields_of(frame[1])
    if not isinstance(payload, tuple) or len(payload) != len(names):
        raise TableError(f"the payload is not an array of {len(names)}; recompile it")
    fields = dict(zip(names, payload, strict=True))
    table = _table(fields)
    readers = {SEVERAL: _with_hypotheses, PUSHING: _with_pushes, CONTACTS: _with_contacts}
    for part in _parts_in(frame[1]):
        table = readers[part](table, fields)
    if format_of(table) != frame[1]:
        raise TableError(
            f"format {frame[1]} is not that of such a table, which is {format_of(table)}"
        )
    return table


def format_of(table: Table) -> int:
    """The number of the format in which a table is written."""
    contacts = any(node.contact_um is not None for node in table.nodes)
    has = {SEVERAL: bool(table.hypotheses), PUSHING: table.pushing is not None, CONTACTS: contacts}
    return FORMAT + sum(more - FORMAT for more in MORE_FIELDS if has[more])


def fields_of(number: int) -> tuple[str, ...]:
    """The fields of the payload in the format of a number."""
    return (*PAYLOAD_FIELDS, *(field for part in _parts_in(number) for field in MORE_FIELDS[part]))


def _parts_in(number: int) -> list[int]:
    """What a format has beside format 3, in its order."""
    return [part for part in MORE_FIELDS if (number - FORMAT) & (part - FORMAT)]


def rows_of(table: Table) -> dict[str, Sequence[Row]]:
    """The records of a table as rows of integers, in the order of `COLUMNS`."""
    return {
        "node": [
            (*node.squeeze, *(node.release or node.squeeze[:2]), len(node.branches))
            for node in table.nodes
        ],
        "branch": [branch for node in table.nodes for branch in node.branches],
        "leaf": [
            (
                *leaf[:3],
                *leaf.covariance,
                *leaf[4:6],
                int(leaf.resolved),
                len(leaf.alternatives),
                *leaf[8:10],
            )
            for leaf in table.leaves
        ],
        "alternative": [pose for leaf in table.leaves for pose in leaf.alternatives],
        "push": [push for node in table.nodes for push in node.pushes],
    }


def _unpacked(data: bytes, name: str) -> object:
    """One msgpack value without maps and extensions; nothing in it is longer than a table's parts may be."""
    most = {"max_array_len": MAX_LEAVES, "max_map_len": 0, "max_ext_len": 0}
    try:
        value: object = msgpack.unpackb(data, use_list=False, **most)
    except msgpack.ExtraData:
        raise TableError(
            f"bytes follow the end of {name}; copy the file again or recompile it"
        ) from None
    except (MemoryError, ValueError, msgpack.UnpackException) as error:
        reason = f"{name} is damaged or cut short ({error}); copy the file again or recompile it"
        raise TableError(reason) from None
    return value


def _header(table: Table) -> list[object]:
    gripper, goal, limits = astuple(table.gripper), astuple(table.goal), astuple(table.limits)
    return [
        table.tool,
        table.job_digest,
        gripper[0],
        gripper[1:],
        (*goal[:4], KINDS.index(table.goal.kind), *table.goal.tolerance, table.goal.modes),
        (*limits[:3], *table.limits.work_area_um, *limits[4:]),
        astuple(table.predicted),
    ]


def _several(table: Table) -> list[object]:
    names, *columns = map(list, zip(*table.hypotheses, strict=True))
    others = [which for leaf in table.leaves for which in leaf.other_hypotheses]
    return [
        int(table.goal.identify),
        names,
        *columns,
        [leaf.hypothesis for leaf in table.leaves],
        others,
    ]


def _pushes(table: Table) -> list[list[int]]:
    rows = rows_of(table)["push"]
    return [[len(node.pushes) for node in table.nodes], *map(list, zip(*rows, strict=True))]


def _contacts(table: Table) -> list[list[int]]:
    openings = (node.squeeze.opening_um for node in table.nodes)
    contacts = (node.contact_um for node in table.nodes)
    return [
        [
            wide if contact is None else contact
            for wide, contact in zip(openings, contacts, strict=True)
        ]
    ]


def _with_contacts(table: Table, fields: dict[str, object]) -> Table:
    """A table with the widths of first contact; the opening itself stands where none is known."""
    contacts = _integers(fields, "node_contact_um", len(table.nodes))
    nodes = (
        node._replace(contact_um=None if contact == node.squeeze.opening_um else contact)
        for node, contact in zip(table.nodes, contacts, strict=True)
    )
    return replace(table, nodes=tuple(nodes))


def _with_pushes(table: Table, fields: dict[str, object]) -> Table:
    """A table with what is pushed before its squeezes."""
    sizes = _integers(fields, "node_pushes", len(table.nodes))
    pushes = _parts(map(Push._make, _rows(fields, "push")), list(sizes), MAX_PUSHES, "node_pushes")
    nodes = zip(table.nodes, pushes, strict=True)
    return replace(table, nodes=tuple(node._replace(pushes=pushed) for node, pushed in nodes))


def _with_hypotheses(table: Table, fields: dict[str, object]) -> Table:
    """A table with the parts that may lie there."""
    identify, names = _typed(fields, "identify", int), _typed(fields, "hypothesis_name", tuple)
    if not 0 <= identify <= 1:
        raise TableError("identify is neither 0 nor 1")
    if not all(type(name) is str for name in names):
        raise TableError("hypothesis_name holds something else than str")
    columns = [
        _integers(fields, f"hypothesis_{field}", len(names)) for field in Hypothesis._fields[1:]
    ]
    which = _integers(fields, "leaf_hypothesis", len(table.leaves))
    sizes = [len(leaf.alternatives) for leaf in table.leaves]
    others = _parts(
        _integers(fields, "alternative_hypothesis", sum(sizes)),
        sizes,
        MAX_ALTERNATIVES,
        "leaf_alternatives",
    )
    leaves = zip(table.leaves, which, others, strict=True)
    return replace(
        table,
        goal=replace(table.goal, identify=bool(identify)),
        hypotheses=tuple(map(Hypothesis._make, zip(names, *columns, strict=True))),
        leaves=tuple(
            leaf._replace(hypothesis=hypothesis, other_hypotheses=rest)
            for leaf, hypothesis, rest in leaves
        ),
    )


def _columns(table: Table) -> Iterator[list[int]]:
    for kind, rows in rows_of(table).items():
        if kind == "push":
            continue
        columns = zip(*rows, strict=True) if rows else [()] * len(COLUMNS[kind])
        yield from map(list, columns)


def _table(fields: dict[str, object]) -> Table:
    distance, confidence, rho, symmetry, kind, x, y, theta, modes = _integers(fields, "goal", 9)
    if not 0 <= kind < len(KINDS):
        raise TableError(f"goal has the kind {kind}, allowed are 0..{len(KINDS) - 1}")
    max_depth, force, speed, x0, y0, x1, y1, retreat, height, arm_speed = _integers(
        fields, "limits", 10
    )
    leaves = _leaves(fields)
    return Table(
        tool=_typed(fields, "tool", str),
        job_digest=_typed(fields, "job_digest", bytes),
        gripper=GripperSpec(_typed(fields, "gripper_model", str), *_integers(fields, "gripper", 6)),
        goal=GoalSpec(distance, confidence, rho, symmetry, KINDS[kind], (x, y, theta), modes),
        limits=Limits(max_depth, force, speed, (x0, y0, x1, y1), retreat, height, arm_speed),
        nodes=_nodes(fields),
        leaves=leaves,
        predicted=Prediction(*_integers(fields, "predicted", 6)),
        job=None if fields["job"] is None else _typed(fields, "job", str),
    )


def _nodes(fields: dict[str, object]) -> tuple[Node, ...]:
    rows = _rows(fields, "node")
    branches = _parts(
        map(Branch._make, _rows(fields, "branch")),
        [row[-1] for row in rows],
        MAX_BRANCHES,
        "node_branches",
    )
    return tuple(
        Node(Squeeze._make(row[:7]), runs, None if row[7:9] == row[:2] else (row[7], row[8]))
        for row, runs in zip(rows, branches, strict=True)
    )


def _leaves(fields: dict[str, object]) -> tuple[Leaf, ...]:
    rows = _rows(fields, "leaf")
    if not all(0 <= row[11] <= 1 for row in rows):
        raise TableError("leaf_resolved holds a number that is neither 0 nor 1")
    alternatives = _parts(
        _rows(fields, "alternative"),
        [row[12] for row in rows],
        MAX_ALTERNATIVES,
        "leaf_alternatives",
    )
    return tuple(
        Leaf._make((*row[:3], row[3:9], row[9], row[10], bool(row[11]), others, *row[13:], 0, ()))
        for row, others in zip(rows, alternatives, strict=True)
    )


def _rows(fields: dict[str, object], kind: str) -> list[Row]:
    names = [f"{kind}_{name}" for name in COLUMNS[kind]]
    length = len(_typed(fields, names[0], tuple))
    return list(zip(*(_integers(fields, name, length) for name in names), strict=True))


def _parts(
    records: Iterable[Kind], sizes: list[int], most: int, name: str
) -> Iterator[tuple[Kind, ...]]:
    """The records in groups of these sizes."""
    left = iter(records)
    for size in sizes:
        items = tuple(islice(left, size)) if 0 <= size <= most else None
        if items is None or len(items) != size:
            raise TableError(
                f"{name} holds {size}, but no more than {most} may be, and as many as follow"
            )
        yield items
    if next(left, None) is not None:
        raise TableError(f"{name} adds up to fewer than there are")


def _integers(fields: dict[str, object], name: str, length: int) -> Row:
    values: Row = _typed(fields, name, tuple)
    if len(values) != length:
        raise TableError(f"{name} holds {len(values)} integers where {length} belong")
    strange = {type(value).__name__ for value in values} - {"int"}
    if strange:
        raise TableError(f"{name} holds {min(strange)} where int belongs")
    return values


def _typed(fields: dict[str, object], name: str, kind: type[Kind]) -> Kind:
    value = fields[name]
    if type(value) is not kind:
        raise TableError(f"{name} holds {type(value).__name__} where {kind.__name__} belongs")
    return value
