"""The reader of format 1: what its writer would not have written is refused, field by field."""

import hashlib
from pathlib import Path

import msgpack
import pytest
from runtime.table_format_1 import PAYLOAD_FIELDS

from runtime.table import TableError, loads

GOLDEN = (Path(__file__).parents[1] / "golden" / "table-format-1.msgpack").read_bytes()


def with_field(name: str, value: object) -> bytes:
    fields = list(msgpack.unpackb(msgpack.unpackb(GOLDEN)[3]))
    fields[PAYLOAD_FIELDS.index(name)] = value
    payload = msgpack.packb(fields)
    return bytes(msgpack.packb(["squeezetree", 1, hashlib.sha256(payload).digest(), payload]))


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("tool", 5, "tool holds int where str belongs"),
        ("goal", [3000, True, 10571, 2], "goal holds bool where int belongs"),
        ("placements", b"\x80", "ends in the middle"),
        ("placements", b"\x00\x00", "not made of rows of 3"),
        ("jaws", b"\xff\xff\xff\xff\xff\xff\xff\x01", "more than 35 bits"),
        ("shapes", b"\x07", "1 shapes for 2 nodes"),
        ("shapes", b"\x01\x04", "a node has 0 branches"),
        ("shapes", b"\x86\x00\x04", "not in the one form"),
        ("nodes", b"\x00\x00\x00\x09\x00\x00", "that is not there"),
        ("branches", b"\x00\x00\x00", "branches end before"),
        ("job", b"text", "job holds bytes where str belongs"),
    ],
)
def test_wrong_field_is_refused_with_its_name(name: str, value: object, reason: str) -> None:
    with pytest.raises(TableError, match=reason):
        loads(with_field(name, value))


def test_more_branches_than_the_nodes_have_are_refused() -> None:
    branches = msgpack.unpackb(msgpack.unpackb(GOLDEN)[3])[PAYLOAD_FIELDS.index("branches")]
    with pytest.raises(TableError, match="more branches than the nodes have"):
        loads(with_field("branches", branches + b"\x00"))
