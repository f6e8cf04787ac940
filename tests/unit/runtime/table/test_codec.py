"""The bytes of a table: they round-trip, each table has one encoding, all else is refused with a reason."""

import hashlib
import subprocess
import sys
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from sample_tables import (
    changed,
    every_field_table,
    pushing_table,
    random_table,
    several_table,
    small_table,
)

from runtime.table import Place, Table, TableError, dump, dumps, load, loads
from runtime.table.codec import FORMAT
from runtime.table.fields import MAX_BYTES
from runtime.table.sections import SECTIONS

SMALL = dumps(small_table())
PAYLOAD = msgpack.unpackb(SMALL)[3]


def framed(payload: bytes, version: object = FORMAT) -> bytes:
    """A file with a payload and its correct digest."""
    return bytes(msgpack.packb(["squeezetree", version, hashlib.sha256(payload).digest(), payload]))


def sections_of(table: Table) -> list[list[object]]:

    return list(msgpack.unpackb(msgpack.unpackb(dumps(table))[3]))


def with_sections(sections: list[list[object]]) -> bytes:

    return framed(bytes(msgpack.packb(sections)))


def with_field(path: str, value: object, table: Table | None = None) -> bytes:
    """The file of a table in which a field has another value; its path is written like "tool.tool"."""
    sections = sections_of(table or small_table())
    name, _, field = path.partition(".")
    (columns,) = (section.columns for section in SECTIONS if section.name == name)
    at = [column.name for column in columns].index(field)
    next(section for section in sections if section[0] == name)[1 + at] = value
    return with_sections(sections)


@pytest.mark.parametrize(
    "table",
    [
        small_table(),
        every_field_table(),
        pushing_table(),
        pushing_table(several_table()),
        random_table(1, 1),
        random_table(2, 300),
    ],
    ids=["small", "every field", "pushes", "pushes several", "one node", "300 nodes"],
)
def test_loads_of_dumps_is_same_table(table):
    data = dumps(table)
    assert loads(data) == table
    assert dumps(loads(data)) == data


PUSH_OWNERS = ([1, 0, 1], [0, 1, 2], [0, 1, -1], [0, 1, 4_095])  # out of order, or of no node
OPTIONAL = ("hypotheses", "releases", "pushes", "contacts")
EMPTY = [[each.name, *[[]] * len(each.columns)] for each in SECTIONS if each.name in OPTIONAL]
LONGER = PAYLOAD.replace(b"\x94\x00\x00\x01\x01", b"\x94\x00\x00\x01\xcc\x01", 1)


@pytest.mark.parametrize(
    "data",
    [
        *(with_sections([*sections_of(small_table()), section]) for section in EMPTY),
        *(with_field("pushes.node", owners, pushing_table()) for owners in PUSH_OWNERS),
        framed(LONGER),  # an integer in two bytes for a 1
    ],
)
def test_loads_other_encoding_of_table_is_refused(data):
    with pytest.raises(TableError, match="not in the canonical encoding of a table"):
        loads(data)


def test_loads_damaged_bit_or_cut_is_refused():
    for at in range(len(SMALL)):
        with pytest.raises(TableError):
            loads(SMALL[:at])
        for bit in range(8):
            damaged = bytearray(SMALL)
            damaged[at] ^= 1 << bit
            with pytest.raises(TableError):
                loads(bytes(damaged))
    with pytest.raises(TableError, match="bytes follow the end of the file"):
        loads(SMALL + b"\0")


SECTIONS_OF_SMALL = sections_of(small_table())


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "the file is damaged or cut short"),
        (b"\xc0", "not a squeezetree table"),
        (b"\x80", "not a squeezetree table"),
        (bytes(msgpack.packb(["squeezetree"])), "not a squeezetree table"),
        *((framed(b"\x90", old), f"format {old} is not read; compile") for old in (2, FORMAT + 1)),
        (framed(b"\x90", True), "format bool is not read"),
        (bytes(msgpack.packb(["squeezetree", FORMAT, b""])), "the frame is not magic, format"),
        (bytes(msgpack.packb(["squeezetree", FORMAT, b"", "text"])), "the frame is not"),
        (bytes(msgpack.packb(["squeezetree", FORMAT, b"", b"\x90"])), "digest does not match"),
        (framed(b"\x90"), "the sections are not tool, job_digest, gripper"),
        (framed(b"\x90\x90"), "bytes follow the end of the payload"),
        (framed(b"\x81\x01\x02"), "the payload is damaged"),
        (framed(b"\xc7\x00\x05"), "the payload is no array of sections"),
        (with_sections([[]]), "the payload is no array of sections"),
        (with_sections([[[]]]), "the sections are not"),
        (with_sections(SECTIONS_OF_SMALL[:-1]), "the sections are not"),
        (with_sections(SECTIONS_OF_SMALL[::-1]), "the sections are not"),
        (with_sections([*SECTIONS_OF_SMALL, SECTIONS_OF_SMALL[0]]), "the sections are not"),
        (with_sections([*SECTIONS_OF_SMALL, ["evidence", 1]]), "the sections are not"),
        (with_sections([["tool"], *SECTIONS_OF_SMALL[1:]]), "tool has 0 fields where 1 belong"),
        (with_field("tool.tool", 5), "tool.tool holds int where str belongs"),
        (with_field("tool.tool", None), "tool.tool holds NoneType where str belongs"),
        (with_field("job.job", b"text", every_field_table()), "job.job holds bytes where str"),
        (with_field("goal.confidence_ppm", True), "goal.confidence_ppm holds bool where int"),
        (with_field("goal.identify", 2), "goal.identify holds a number that is neither 0 nor 1"),
        (with_field("nodes.x_um", 0), "nodes.x_um holds int where an array belongs"),
        (with_field("nodes.x_um", [0]), "nodes has arrays of different lengths"),
        (with_field("nodes.x_um", [0, 1.0]), "nodes.x_um holds float where int belongs"),
        (with_field("nodes.y_um", {}), "damaged|holds dict"),
        (with_field("leaves.resolved", [1, 1, 2]), "holds a number that is neither 0 nor 1"),
        (with_field("branches.node", [0, 0, 0, 0]), "node 1: number of branches is 0"),
    ],
)
def test_loads_malformed_bytes_are_refused_with_reason(data, reason):
    with pytest.raises(TableError, match=reason):
        loads(data)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("tool", 5),
        ("goal.kind", "there"),
        ("goal.tolerance", (1, 2)),
        ("nodes.0.squeeze.x_um", np.int64(0)),
        ("nodes.0.squeeze.x_um", 0.0),
        ("nodes.0.squeeze", (1, 2)),
        ("nodes.0.release", Place(0, 0)),  # where the hand stands
        ("leaves.0.trials", True),
        ("leaves.0.resolved", None),
        ("leaves.0.trials", 1 << 70),
    ],
)
def test_dumps_value_that_would_not_round_trip_is_refused(path, value):
    with pytest.raises(TableError):
        dumps(changed(small_table(), {path: value}))


# -- exhausting the reader ------------------------------------------------------------------------

# Reads files in an address space with 128 MiB to spare and prints each refusal.
READ = """
import resource, sys
from runtime.table import TableError, load
now = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + (128 << 20), now + (128 << 20)))
resource.setrlimit(resource.RLIMIT_CPU, (20, 20))
for path in sys.argv[1:]:
    try:
        load(path)
    except TableError as error:
        print(error)
"""
MANY = 16_384
HOSTILE = [
    (with_field("nodes.x_um", [0] * MANY), "arrays of different lengths"),
    (with_field("nodes.x_um", [0] * (MANY + 1)), "damaged or cut short"),
    (with_field("tool.tool", "x" * (3 << 20)), "bytes, allowed are"),
    (b"\x91" * 100_000, "not a squeezetree table"),
    (b"x_mm,y_mm\n0,0\n30,0\n", "not a squeezetree table"),
    (framed(b"\x91" * 1_000_000), "damaged or cut short"),
    (framed(b"\xdc\x3f\xff" + (b"\xdc\x00\x40" + b"\x90" * 64) * 16_383), "the sections are not"),
    (b"\xdd\xff\xff\xff\xff", "not a squeezetree table"),
    (b"\xc6\xff\xff\xff\xff", "not a squeezetree table"),
    (bytes(MAX_BYTES + 1), "bytes, allowed are"),
]


def test_load_exhausting_file_is_refused_in_little_memory(tmp_path):
    paths = [tmp_path / f"{number}.msgpack" for number in range(len(HOSTILE))]
    for path, (data, _) in zip(paths, HOSTILE, strict=True):
        path.write_bytes(data)
    command = [sys.executable, "-c", READ, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for line, (_, reason) in zip(done.stdout.splitlines(), HOSTILE, strict=True):
        assert reason in line


# -- files ----------------------------------------------------------------------------------------


def test_dump_of_invalid_table_keeps_old_file(tmp_path):
    path = tmp_path / "small.msgpack"
    dump(small_table(), path)
    assert load(path) == (small_table(), SMALL, hashlib.sha256(SMALL).hexdigest())
    with pytest.raises(TableError):
        dump(replace(small_table(), nodes=()), path)
    assert path.read_bytes() == SMALL
    assert [entry.name for entry in tmp_path.iterdir()] == ["small.msgpack"]


def test_load_error_names_file_and_remedy(tmp_path):
    (tmp_path / "cut.msgpack").write_bytes(SMALL[:-1])
    for name, said in (("none.msgpack", "No such file"), ("cut.msgpack", "copy the file again")):
        with pytest.raises(TableError, match=rf"{name}.*{said}"):
            load(tmp_path / name)
