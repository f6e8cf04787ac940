"""Zip archives with fully prescribed bytes: the container of a pack.

The members follow one another, not compressed, dated 1980-01-01, with mode 0644; the zip's directory lists
them in the same order. The comment at the end is an Ed25519 signature of all bytes before it: `tail -c 64`
extracts the signature for OpenSSL. A reader builds the archive anew from its members and compares the bytes,
so that it detects each changed byte, and the member that was changed. Any zip program opens the archive
(APPNOTE.TXT 6.3.10, sections 4.3 and 4.4).
"""

import struct
import zlib
from collections.abc import Collection, Mapping

from runtime.errors import PackError

SIGNATURE_BYTES = 64
_LOCAL, _CENTRAL, _END = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
# version 2.0, no compression, the first day that zip can state
_NEEDED, _STORED, _DATE = 20, 0, 0x21
_MADE_BY, _MODE = 3 << 8 | _NEEDED, 0o100644 << 16  # on Unix
_LOCAL_BYTES = 30
_LONGEST_SHOWN = 200  # longest unknown name in a message
_SIZE_AT = 18  # of a member's stored size in its local header


def unsigned(members: Mapping[str, bytes]) -> bytes:
    """Builds the bytes of an archive up to its signature, which the caller appends.

    Args:
        members: contents of the members by name (ASCII), in the order of the archive.
    """
    entries = b"".join(_local(name, content) + content for name, content in members.items())
    return entries + _directory(members)


def members_of(data: bytes, names: Collection[str]) -> dict[str, bytes]:
    """Reads the members of an archive; the signature is not checked.

    The bytes before the signature must be those that `unsigned` returns for these members.

    Args:
        data: the bytes of the archive.
        names: allowed names of members.

    Raises:
        PackError: the archive was changed; the message names the member or the place.
    """
    if not data.startswith(_LOCAL):
        raise PackError("is no zip archive that squeezetree pack wrote")
    members: dict[str, bytes] = {}
    at = 0
    while (name := _name_at(data, at, names)) is not None:
        if name in members:
            raise PackError(f"holds {name} twice")
        start = at + _LOCAL_BYTES + len(name)
        size = int.from_bytes(data[at + _SIZE_AT : at + _SIZE_AT + 4], "little")
        content = data[start : start + size]
        if data[at:start] != _local(name, content):
            raise PackError(f"{name} was changed or cut short after the pack was written")
        members[name] = content
        at = start + len(content)
    directory = data[at:-SIGNATURE_BYTES]
    if directory != _directory(members):
        raise PackError(f"the zip's own fields were changed, cut short or added to after byte {at}")
    return members


def _name_at(data: bytes, at: int, names: Collection[str]) -> str | None:
    """The name of the member whose header begins at byte `at`; None where no header begins."""
    start = at + _LOCAL_BYTES
    # a member whose first bytes were changed is still recognised by its name
    if not data.startswith(_LOCAL, at):
        return next((name for name in names if data.startswith(name.encode("ascii"), start)), None)
    length = int.from_bytes(data[start - 4 : start - 2], "little")
    stated = data[start : start + min(length, _LONGEST_SHOWN)].decode("ascii", "backslashreplace")
    if stated in names:
        return stated
    raise PackError(f"holds {stated!r}, which is no file of a pack")


def _local(name: str, content: bytes) -> bytes:
    return _LOCAL + struct.pack("<H", _NEEDED) + _described(name, content) + name.encode("ascii")


def _described(name: str, content: bytes) -> bytes:
    """The bytes that describe a member, equal in its header and in the zip's directory."""
    flags, time, extra = 0, 0, 0
    size = len(content)
    fields = (flags, _STORED, time, _DATE, zlib.crc32(content), size, size, len(name), extra)
    return struct.pack("<4H3I2H", *fields)


def _directory(members: Mapping[str, bytes]) -> bytes:
    lines, at = b"", 0
    for name, content in members.items():
        lines += _CENTRAL + struct.pack("<2H", _MADE_BY, _NEEDED) + _described(name, content)
        lines += struct.pack("<3H2I", 0, 0, 0, _MODE, at) + name.encode("ascii")
        at += _LOCAL_BYTES + len(name) + len(content)
    count = len(members)
    return lines + _END + struct.pack("<4H2IH", 0, 0, count, count, len(lines), at, SIGNATURE_BYTES)
