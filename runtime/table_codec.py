"""The bytes of a table: the frame around a payload, whose format its number tells."""

import hashlib

import msgpack  # type: ignore[import-untyped]

from runtime import table_format_1, table_format_2
from runtime.errors import TableError
from runtime.table_columns import unpack
from runtime.table_model import FORMAT, MAGIC, Table

MAX_BYTES = 4 << 20
FRAME_FIELDS = ("magic", "format", "digest", "payload")
READERS = {1: table_format_1.table_of, 2: table_format_2.table_of}


def encode(table: Table) -> bytes:
    """The bytes of a table in its canonical form; proves nothing.

    Raises:
        TableError: a value does not fit its field.
    """
    payload = table_format_2.payload_of(table)
    frame = bytes(msgpack.packb([MAGIC, FORMAT, hashlib.sha256(payload).digest(), payload]))
    if len(frame) > MAX_BYTES:
        raise TableError(f"the table takes {len(frame)} bytes, more than the {MAX_BYTES} a reader accepts")
    return frame


def decode(data: bytes) -> Table:
    """The table in some bytes, if its format's writer gives these very bytes; proves nothing.

    Raises:
        TableError: with the first reason found why these bytes are not a table.
    """
    if len(data) > MAX_BYTES:
        raise TableError(f"longer than {MAX_BYTES} bytes; this is not a table")
    frame = unpack(data, "the file")
    if not isinstance(frame, tuple) or len(frame) < 2 or frame[0] != MAGIC:
        raise TableError("not a squeezetree table; pass the .msgpack file plan-compile wrote")
    version = frame[1]
    if type(version) is not int or version not in READERS:
        readable = " and ".join(map(str, READERS))
        raise TableError(f"format {version} is not readable; this runtime reads {readable}")
    if len(frame) != len(FRAME_FIELDS) or not all(type(part) is bytes for part in frame[2:]):
        raise TableError(f"the frame is not {', '.join(FRAME_FIELDS)}; copy the file again or recompile it")
    if hashlib.sha256(frame[3]).digest() != frame[2]:
        raise TableError("digest does not match its content; copy the file again or recompile it")
    payload = unpack(frame[3], "the payload")
    if msgpack.packb(frame) != data or msgpack.packb(payload) != frame[3]:
        raise TableError("not in the one form this table is written in; recompile it")
    return READERS[version](payload)
