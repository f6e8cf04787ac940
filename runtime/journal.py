"""The journal of a run: append-only JSON lines, chained by their digests.

A line's last field, `digest`, is the SHA-256 of the line without that field; `previous` is the digest of the
line before. So a changed, missing or inserted line shows.

A record is on the disk when `Journal.record` returns. A run begins with a header that embeds the table, so
that the file alone is enough to check every decision, and ends with a record of kind `end`; a run without it
broke off. In between, for each part: `part`, then a `placed` and a `squeeze` for each squeeze, `audit` and
`delivery` where there is one, `outcome`; after a crash `resume` and `freed`; and anywhere `link`, a retry or
a failure on the way to the gripper.
"""

import base64
import contextlib
import fcntl
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from runtime.errors import JournalError, TornError
from runtime.shell import strict_json

VERSION = 1
GENESIS = "0" * 64
MAX_LINE_BYTES = 8 << 20
RESERVED = frozenset({"seq", "time", "kind", "previous", "digest"})


class _End(NamedTuple):
    """Where a journal ends: the last record's digest, the number of records, of bytes."""

    head: str
    records: int
    size: int


class Journal:
    """A journal being written. An existing one is verified and continued, never overwritten.

    A last line that a crash cut short is cut off: its record never returned, so nothing was done upon it.

    Attributes:
        path: the file.
        cut_bytes: length of the unfinished line that was cut off, 0 for none.
    """

    def __init__(self, path: Path, stamp: Callable[[], str]) -> None:
        """Create the file, or verify it and go on at its end.

        Args:
            path: the file.
            stamp: what each record is dated with, `Clock.stamp`.

        Raises:
            JournalError: it cannot be opened, another process writes it, or what it holds does not verify.
        """
        self.path = path
        self.cut_bytes = 0
        self._stamp = stamp
        self._end = _End(GENESIS, 0, 0)
        self._failed = False
        try:
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            self._claim()
        except BaseException:  # Ctrl-C, too, must not leave the file claimed
            self.close()
            raise

    def _claim(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _sync_directory(self.path.parent)
            self._cut_torn_line()
        except BlockingIOError:
            raise JournalError(self.path, "is being written by another process; name another file") from None
        except OSError as error:
            raise _unwritable(self.path, error) from error
        if self._end.size:
            held = verify(self.path)
            self._end = _End(held.head, held.records, self._end.size)

    def _cut_torn_line(self) -> None:
        size = os.fstat(self._file).st_size
        whole = _end_of_last_line(self._file, size)
        self._end = _End(GENESIS, 0, whole)
        self.cut_bytes = size - whole
        if self.cut_bytes:
            os.ftruncate(self._file, whole)
            os.fsync(self._file)

    def header(self, table: bytes, fields: Mapping[str, object]) -> None:
        """Write the first record: the table's bytes and their digest, and what else tells the run apart.

        Raises:
            JournalError: it cannot be written.
        """
        embedded = {
            "journal_version": VERSION,
            "table_sha256": hashlib.sha256(table).hexdigest(),
            "table_base64": base64.b64encode(table).decode("ascii"),
        }
        self.record("header", {**fields, **embedded})

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Append one record and bring it to the disk.

        Args:
            kind: what it tells.
            fields: values JSON can hold, none of them under a name in `RESERVED`.

        Raises:
            JournalError: it cannot be written: full disk, lost mount, closed journal.
            ValueError: a field has a reserved name or is not a number JSON can hold.
        """
        if self._failed:
            told = "could not be written before, and what it holds since is not known"
            raise JournalError(self.path, f"{told}; free the disk or name another file")
        if clash := RESERVED & fields.keys():
            raise ValueError(f"reserved field names: {sorted(clash)}")
        end = self._end
        frame = {"seq": end.records, "time": self._stamp(), "kind": kind, **fields, "previous": end.head}
        body = json.dumps(frame, separators=(",", ":"), allow_nan=False).encode("ascii")
        digest = hashlib.sha256(body).hexdigest()
        line = body[:-1] + _tail(digest)
        try:
            _write_all(self._file, line)
            os.fsync(self._file)
            # One assignment: a stop request comes before it or after it, never in between.
            self._end = _End(digest, end.records + 1, end.size + len(line))
        except OSError as error:
            self._failed = True  # a failed sync cannot be repeated
            self._take_back()
            raise _unwritable(self.path, error) from error
        except BaseException:  # a stop request
            self._take_back()
            raise

    def _take_back(self) -> None:
        """Take back a line that was written in part, or wholly but is not counted yet."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._file, self._end.size)

    def close(self) -> None:
        """Close the file; nothing can be recorded afterwards. Closing twice is harmless."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@dataclass(frozen=True, slots=True)
class Verified:
    """What a journal that verifies is about.

    Attributes:
        records: number of records.
        runs: number of runs, each begun by a header.
        table: the bytes of the table embedded for the last run.
        closed: whether the last run wrote its last record.
        head: digest of the last record, what the next one has to hold.
    """

    records: int
    runs: int
    table: bytes
    closed: bool
    head: str


def verify(path: Path) -> Verified:
    """Check every line of a journal: whole, numbered, chained, the tables as their digests say.

    Raises:
        JournalError: naming the first line that does not verify.
    """
    number, runs, closed, table, head = 0, 0, True, b"", GENESIS
    for entry, digest in _chain(path):
        number, head = number + 1, digest
        if entry["kind"] == "header":
            table, runs, closed = _embedded_table(path, number, entry), runs + 1, False
        elif closed:
            raise JournalError(path, "does not belong to a run; a header was expected", number)
        else:
            closed = entry["kind"] == "end"
    if number == 0:
        raise JournalError(path, "is empty")
    return Verified(number, runs, table, closed, head)


def records(path: Path) -> Iterator[dict[str, object]]:
    """The records of a journal, each checked against the chain before it is given out.

    Raises:
        JournalError: the file cannot be read, or naming the first line that does not verify.
    """
    return (entry for entry, _ in _chain(path))


def _chain(path: Path) -> Iterator[tuple[dict[str, object], str]]:
    """Each record with its digest."""
    head = GENESIS
    try:
        with path.open("rb") as file:
            for number in count(1):
                if not (line := file.readline(MAX_LINE_BYTES)):
                    return
                entry = _checked(path, number, line, head)
                head = str(entry["digest"])
                yield entry, head
    except OSError as error:
        raise JournalError(path, f"cannot be read: {error.strerror}") from error


def _checked(path: Path, number: int, line: bytes, previous: str) -> dict[str, object]:
    if not line.endswith(b"\n"):
        raise TornError(path, "cut short; the run ended while it was written", number)
    if b',"digest":"' not in line[-len(_tail(GENESIS)) :]:
        raise JournalError(path, "is no record of a journal", number)
    body = line[: -len(_tail(GENESIS))] + b"}"
    if line != body[:-1] + _tail(hashlib.sha256(body).hexdigest()):
        raise JournalError(path, "does not have its digest; it was changed after it was written", number)
    try:
        entry = strict_json.parse(line)
    except ValueError as error:
        raise JournalError(path, f"is {error}", number) from None
    if not isinstance(entry, dict) or not entry.keys() >= RESERVED:
        raise JournalError(path, f"lacks one of {', '.join(sorted(RESERVED))}", number)
    if type(entry["seq"]) is not int or entry["seq"] != number - 1:
        raise JournalError(path, f"has sequence number {entry['seq']}, expected {number - 1}", number)
    if entry["previous"] != previous:
        raise JournalError(path, "does not follow the line before it", number)
    kind = entry["kind"]
    if not (isinstance(kind, str) and kind.isidentifier() and isinstance(entry["time"], str)):
        raise JournalError(path, "has a kind that is no word, or a time that is no text", number)
    if kind == "header":
        _embedded_table(path, number, entry)
    return entry


def _embedded_table(path: Path, number: int, entry: Mapping[str, object]) -> bytes:
    if entry.get("journal_version") != VERSION:
        raise JournalError(path, f"is not a header of journal version {VERSION}", number)
    try:
        table = base64.b64decode(str(entry.get("table_base64")), validate=True)
    except ValueError:
        raise JournalError(path, "the embedded table is not base64", number) from None
    if hashlib.sha256(table).hexdigest() != entry.get("table_sha256"):
        raise JournalError(path, "the embedded table is not the one of its digest", number)
    return table


def _tail(digest: str) -> bytes:
    """What ends a line: its digest, in place of the body's closing brace."""
    return f',"digest":"{digest}"}}\n'.encode("ascii")


def _write_all(file: int, data: bytes) -> None:
    while data:
        data = data[os.write(file, data) :]


def _end_of_last_line(file: int, size: int) -> int:
    """Where the last whole line of a file ends; at most `MAX_LINE_BYTES` are looked through."""
    start = max(size - MAX_LINE_BYTES, 0)
    tail = b""
    while start + len(tail) < size and (piece := os.pread(file, size - start - len(tail), start + len(tail))):
        tail += piece
    return start + tail.rfind(b"\n") + 1 if b"\n" in tail or start == 0 else size


def _sync_directory(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _unwritable(path: Path, error: OSError) -> JournalError:
    remedy = "make its folder" if isinstance(error, FileNotFoundError) else "free the disk"
    return JournalError(path, f"cannot be written: {error.strerror}; {remedy} or name another file")
