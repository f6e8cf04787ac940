"""Files made to exhaust the reader: refused in bounded time and memory, measured from outside."""

import hashlib
import subprocess
import sys
import zlib
from pathlib import Path

import msgpack
import pytest
from runtime.table_deflate import deflate
from sample_tables import small_table

from runtime.table import MAX_BYTES, PAYLOAD_FIELDS, dumps

# Reads a file with an address space that leaves the reader 64 MiB, then says what it said.
READ = """
import resource, sys
from runtime.table import TableError, load
now = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + (64 << 20), now + (64 << 20)))
resource.setrlimit(resource.RLIMIT_CPU, (20, 20))
try:
    load(sys.argv[1])
except TableError as error:
    print(error)
"""


def zeros(count: int) -> bytes:
    """A deflate stream of so many zero bytes, a thousandth of their size."""
    stream = zlib.compressobj(9, wbits=-15)
    return stream.compress(bytes(count)) + stream.flush()


def ones(count: int) -> bytes:
    stream = zlib.compressobj(9, wbits=-15)
    return stream.compress(b"\x01" * count) + stream.flush()


def framed(fields: dict[str, object], version: int = 2) -> bytes:
    payload = list(msgpack.unpackb(msgpack.unpackb(dumps(small_table()))[3]))
    for name, value in fields.items():
        payload[PAYLOAD_FIELDS.index(name)] = value
    packed = msgpack.packb(payload)
    return bytes(msgpack.packb(["squeezetree", version, hashlib.sha256(packed).digest(), packed]))


HOSTILE = {
    "a bomb of shapes": (framed({"shapes": zeros(1 << 30)}), "longer than any table needs"),
    "the most shapes": (framed({"shapes": ones((1 << 14) * 5)}), "holds 81920 integers, allowed are 16384"),
    "many leaves": (framed({"shapes": deflate(b"\x80\x80\x80\x80\x01" * (1 << 14))}), "besides the root"),
    "alternatives": (framed({"alternatives": deflate(b"\xff\xff\xff\xff\x7f" * 3)}), "alternatives, allowed"),
    "a huge variance": (framed({"spreads": deflate(b"\xff\xff\xff\xff\x7f" * 18)}), "variance is greater"),
    "a huge clearance": (
        framed({"clearances": deflate(b"\xff\xff\xff\xff\x7f" * 2)}),
        "clearance is greater",
    ),
    "a long text": (framed({"tool": "x" * (3 << 20)}), "damaged or cut short"),
    "many jaw settings": (framed({"jaws": deflate(b"\xff\xff\xff\xff\x7f" * 2)}), "first use"),
    "nested arrays": (b"\x91" * 100_000, "damaged or cut short"),
    "an array of 2^32": (b"\xdd\xff\xff\xff\xff", "damaged or cut short"),
    "four gigabytes announced": (b"\xc6\xff\xff\xff\xff", "damaged or cut short"),
    "a file without end": (bytes(MAX_BYTES + 1), "longer than"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_file_is_refused_within_64_mib(name: str, tmp_path: Path) -> None:
    data, reason = HOSTILE[name]
    path = tmp_path / "hostile.msgpack"
    path.write_bytes(data)
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert reason in done.stdout
