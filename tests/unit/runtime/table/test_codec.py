"""The bytes of a table: there and back, one encoding each, all else refused with a reason."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from random import Random

import msgpack
import numpy as np
import pytest
from grown_tables import grown_table
from sample_tables import (
    every_field_table,
    pushing_table,
    random_table,
    several_table,
    small_table,
    with_leaf,
    with_node,
)

from runtime import table as package
from runtime.table import Table, TableError, dump, dumps, load, loads
from runtime.table.codec import MAX_BYTES, PAYLOAD_FIELDS

SMALL = dumps(small_table())


def framed(payload: bytes, version: object = 3) -> bytes:
    """A file around a payload, its digest right."""
    return bytes(msgpack.packb(["squeezetree", version, hashlib.sha256(payload).digest(), payload]))


def with_field(name: str, value: object, table: Table | None = None) -> bytes:
    """The file of a table with another value in a field of its payload."""
    fields = list(msgpack.unpackb(msgpack.unpackb(dumps(table or small_table()))[3]))
    fields[PAYLOAD_FIELDS.index(name)] = value
    return framed(bytes(msgpack.packb(fields)))


@pytest.mark.parametrize(
    "table",
    [
        small_table(),
        every_field_table(),
        pushing_table(),
        pushing_table(several_table()),
        random_table(1, 1),
        random_table(2, 300),
        grown_table(3, 400),
    ],
    ids=["small", "every field", "pushes", "pushes several", "one node", "300 nodes", "400 nodes"],
)
def test_a_table_comes_back_as_it_is(table: Table) -> None:
    data = dumps(table)
    assert loads(data) == table
    assert dumps(loads(data)) == data


@pytest.mark.parametrize("whole", [small_table(), several_table()], ids=["one part", "several"])
def test_a_table_without_pushes_has_no_format_of_pushes(whole: Table) -> None:
    number, _, payload = msgpack.unpackb(dumps(whole))[1:]
    fields = [*msgpack.unpackb(payload), [0, 0], *[[]] * 6]
    with pytest.raises(
        TableError, match=f"format {number + 2} is not that of such a table, which is {number}"
    ):
        loads(framed(bytes(msgpack.packb(fields)), number + 2))


@pytest.mark.parametrize(
    ("at", "column", "reason"),
    [
        (0, [1, 5], "node_pushes holds 5, but no more than 4 may be, and as many as follow"),
        (0, [1, 1], "node_pushes adds up to fewer than there are"),
        (0, [1], "node_pushes holds 1 integers where 2 belong"),
        (1, [0, 60_001, 0], "node 1, push 0: x_um is 60001, allowed is -60000..60000"),
        (4, [0, 0, 85_001], "node 1, push 1: opening_um is 85001, allowed is 0..85000"),
        (5, [0, 1, 1], "node 0, push 0: length_um is 0, allowed is 1..1000000"),
        (5, [110_001, 1, 1], "node 0, push 0: x_um of its end is 60001, allowed is -60000..60000"),
        (6, [1, 1, 400_001], "node 1, push 1: speed_um_s is 400001, allowed is 1..400000"),
        (6, [1, 1, 1.0], "push_speed_um_s holds float where int belongs"),
    ],
)
def test_pushes_that_must_not_be_made_are_refused(at: int, column: list[int], reason: str) -> None:
    fields = list(msgpack.unpackb(msgpack.unpackb(dumps(pushing_table()))[3]))
    fields[len(PAYLOAD_FIELDS) + at] = column
    with pytest.raises(TableError) as refusal:
        loads(framed(bytes(msgpack.packb(fields)), 5))
    assert str(refusal.value) == reason


def test_a_table_of_400_nodes_is_small() -> None:
    assert len(dumps(grown_table(3, 400))) < 40_000


def test_every_damaged_bit_and_every_cut_is_refused() -> None:
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


def test_an_integer_in_a_longer_form_is_refused() -> None:
    payload = msgpack.unpackb(SMALL)[3]
    longer = payload.replace(
        b"\x92\x02\x02", b"\x92\xcc\x02\x02", 1
    )  # node_branches, two bytes for a 2
    assert longer != payload
    with pytest.raises(TableError, match="not in the one encoding a table has"):
        loads(framed(longer))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "the file is damaged or cut short"),
        (b"\xc0", "not a squeezetree table"),
        (b"\x80", "not a squeezetree table"),
        (bytes(msgpack.packb(["squeezetree"])), "not a squeezetree table"),
        (framed(b"\x90", 2), "format 2 is not readable; this runtime reads 3 to 10, recompile it"),
        (framed(b"\x90", True), "format bool is not readable"),
        (
            bytes(msgpack.packb(["squeezetree", 3, b""])),
            "the frame is not magic, format, digest, payload",
        ),
        (bytes(msgpack.packb(["squeezetree", 3, b"", "text"])), "the frame is not"),
        (
            bytes(msgpack.packb(["squeezetree", 3, b"", b"\x90"])),
            "digest does not match its content",
        ),
        (framed(b"\x90"), f"the payload is not an array of {len(PAYLOAD_FIELDS)}"),
        (framed(b"\x90\x90"), "bytes follow the end of the payload"),
        (framed(b"\x81\x01\x02"), "the payload is damaged"),
        (framed(b"\xc7\x00\x05"), "the payload is not an array"),
        (with_field("tool", 5), "tool holds int where str belongs"),
        (with_field("tool", None), "tool holds NoneType where str belongs"),
        (with_field("job", b"text"), "job holds bytes where str belongs"),
        (
            with_field("goal", [3000, True, 10571, 2, 0, 0, 0, 0, 1]),
            "goal holds bool where int belongs",
        ),
        (with_field("goal", [3000, 990000, 10571, 2, 5, 0, 0, 0, 1]), "goal has the kind 5"),
        (with_field("gripper", [1, 2]), "gripper holds 2 integers where 6 belong"),
        (with_field("node_x_um", [0]), "node_y_um holds 2 integers where 1 belong"),
        (with_field("node_x_um", [0, 1.0]), "node_x_um holds float where int belongs"),
        (with_field("node_y_um", {}), "damaged|holds dict"),
        (with_field("node_branches", [2, 3]), "node_branches holds 3, but"),
        (with_field("node_branches", [2, 1]), "node_branches adds up to fewer"),
        (with_field("node_branches", [2, -1]), "node_branches holds -1, but"),
        (
            with_field("leaf_resolved", [1, 1, 2]),
            "leaf_resolved holds a number that is neither 0 nor 1",
        ),
        (with_field("leaf_alternatives", [0, 0, 1]), "leaf_alternatives holds 1, but"),
    ],
)
def test_hostile_bytes_are_refused_with_a_reason(data: bytes, reason: str) -> None:
    with pytest.raises(TableError, match=reason):
        loads(data)


ROOT = small_table().nodes[0]


@pytest.mark.parametrize(
    "table",
    [
        replace(small_table(), tool=5),
        replace(small_table(), goal=replace(small_table().goal, kind="there")),
        replace(small_table(), goal=replace(small_table().goal, tolerance=(1, 2))),
        with_node(small_table(), 0, ROOT._replace(squeeze=ROOT.squeeze._replace(x_um=np.int64(0)))),
        with_node(small_table(), 0, ROOT._replace(squeeze=ROOT.squeeze._replace(x_um=0.0))),
        with_node(small_table(), 0, ROOT._replace(squeeze=(1, 2))),
        with_node(small_table(), 0, ROOT._replace(release=(0, 0))),  # where the hand stands
        with_leaf(small_table(), 0, small_table().leaves[0]._replace(trials=True)),
        with_leaf(small_table(), 0, small_table().leaves[0]._replace(resolved=None)),
        with_leaf(small_table(), 0, small_table().leaves[0]._replace(trials=1 << 70)),
    ],
)
def test_what_would_not_come_back_as_it_is_has_no_bytes(table: Table) -> None:
    with pytest.raises(TableError):
        dumps(table)


# -- exhausting the reader ------------------------------------------------------------------------

# Reads a file with an address space that leaves the reader 128 MiB, then says what it said.
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
    (with_field("node_x_um", [0] * MANY), "holds 2 integers where 16384 belong"),
    (with_field("node_x_um", [0] * (MANY + 1)), "damaged or cut short"),
    (with_field("tool", "x" * (3 << 20)), "bytes, allowed are"),
    (b"\x91" * 100_000, "not a squeezetree table"),
    (b"x_mm,y_mm\n0,0\n30,0\n", "not a squeezetree table"),
    (framed(b"\x91" * 1_000_000), "damaged or cut short"),
    (
        framed(b"\xdc\x3f\xff" + (b"\xdc\x00\x40" + b"\x90" * 64) * 16_383),
        "the payload is not an array",
    ),
    (b"\xdd\xff\xff\xff\xff", "not a squeezetree table"),
    (b"\xc6\xff\xff\xff\xff", "not a squeezetree table"),
    (bytes(MAX_BYTES + 1), "bytes, allowed are"),
]


def test_files_made_to_exhaust_the_reader_are_refused_in_little_memory(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.msgpack" for number in range(len(HOSTILE))]
    for path, (data, _) in zip(paths, HOSTILE, strict=True):
        path.write_bytes(data)
    command = [sys.executable, "-c", READ, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for line, (_, reason) in zip(done.stdout.splitlines(), HOSTILE, strict=True):
        assert reason in line


# -- files ----------------------------------------------------------------------------------------


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "small.msgpack"
    dump(small_table(), path)
    assert load(path) == (small_table(), SMALL, hashlib.sha256(SMALL).hexdigest())
    with pytest.raises(TableError):
        dump(replace(small_table(), nodes=()), path)
    assert path.read_bytes() == SMALL
    assert [entry.name for entry in tmp_path.iterdir()] == ["small.msgpack"]


def test_a_failed_write_leaves_no_litter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        dump(small_table(), tmp_path / "small.msgpack")
    assert list(tmp_path.iterdir()) == []


def test_errors_name_the_file_and_carry_their_codes(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="No such file") as missing:
        load(tmp_path / "none.msgpack")
    assert missing.value.exit_code == 3
    damaged = bytearray(SMALL)
    damaged[Random(1).randrange(60, len(SMALL))] ^= 1
    (tmp_path / "rectangle.msgpack").write_bytes(damaged)
    with pytest.raises(TableError) as refused:
        load(tmp_path / "rectangle.msgpack")
    assert refused.value.exit_code == 3
    assert str(refused.value) == (
        "table rectangle.msgpack: digest does not match its content; copy the file again or recompile it"
    )


def test_exported_names_exist_once() -> None:
    assert sorted(set(package.__all__)) == sorted(package.__all__)
    assert [name for name in package.__all__ if not hasattr(package, name)] == []
