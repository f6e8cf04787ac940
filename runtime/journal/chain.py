"""The journal of a run: append-only JSON lines, chained by their digests.

A line's last field, `digest`, is the SHA-256 of the line without that field; `previous` is the digest of the
line before. So a changed, missing or inserted line shows.

A record is on the disk when `Journal.record` returns. A run begins with a header that embeds the table, so
that the file alone is enough to check every decision, and ends with a record of kind `end`; a run without it
broke off. In between, for each part: `part`, then a `placed` and a `squeeze` for each squeeze, `audit` and
`delivery` where there is one, `outcome`, and `truth`, where a simulated part really lay; after a crash
`resume` and `freed`; instead of parts `put_down`; and anywhere `link`, a retry or a failure on the way to the
gripper.
"""

import base64
import contextlib
import fcntl
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import BinaryIO, NamedTuple, Self

from runtime.errors import JournalError, TornError
from runtime.shell import strict_json
from runtime.shell.files import bring_to_disk, oddity
from runtime.shell.sealed_lines import GENESIS, is_intact, sealed

VERSION = 1
MAX_LINE_BYTES = 8 << 20
OPENING = b'{"seq":'
MOST_INCIDENTS = 1000  # kept; of a link so bad that connecting takes more, the first ones tell enough
RESERVED = frozenset({"seq", "time", "kind", "previous", "digest"})


class Verified(NamedTuple):
    """What a journal that verifies holds."""

    head: str = GENESIS  # digest of the last record, what the next one has to hold
    records: int = 0  # number of records
    size: int = 0  # their length, bytes
    runs: int = 0  # number of runs, each begun by a header
    closed: bool = True  # whether the last run wrote its last record


class Journal:
    """A journal being written. An existing one is verified and continued, never overwritten.

    A last line that a crash cut short is cut off: its record never returned, so nothing was done upon it. A
    file that holds anything else is left as it is.
    """

    def __init__(self, path: Path, stamp: Callable[[], str]) -> None:
        """Create the file, or verify it and go on at its end; `stamp` (`Clock.stamp`) dates each record.

        Raises:
            JournalError: it cannot be opened, another process writes it, or what it holds does not verify.
        """
        self.path = path
        self.cut_bytes = 0  # length of the unfinished line that was cut off
        self._stamp = stamp
        self._end = Verified()
        self._failed = False
        try:
            self._file = _opened(path)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            self._claim()
        except BaseException:  # Ctrl-C, too, must not leave the file claimed
            self.close()
            raise

    def _claim(self) -> None:
        """Lock and verify the file; only then cut what a crash left unfinished at its end."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            bring_to_disk(self.path.parent)
            with open(self._file, "rb", closefd=False) as file:
                self._end = _verified(self.path, file, torn=True)
                self.cut_bytes = file.seek(0, os.SEEK_END) - self._end.size
            if self.cut_bytes:
                os.ftruncate(self._file, self._end.size)
                os.fsync(self._file)
        except BlockingIOError:
            raise JournalError(self.path, "is being written by another process; name another file") from None
        except OSError as error:
            raise _unwritable(self.path, error) from error

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
        line, digest = sealed(body)
        try:
            _write_all(self._file, line)
            os.fsync(self._file)
            # One assignment: a stop request comes before it or after it, never in between.
            self._end = Verified(digest, end.records + 1, end.size + len(line))
        except OSError as error:
            self._failed = True  # a failed sync cannot be repeated
            self._take_back()
            raise _unwritable(self.path, error) from error
        except BaseException:  # a stop request
            self._take_back()
            raise

    def _take_back(self) -> None:
        """Remove a line that was written in part, or wholly but is not counted yet."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._file, self._end.size)

    def close(self) -> None:
        """Close the file; nothing can be recorded afterwards. Closing twice is harmless."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Incidents:
    """Retries and failures on the drivers' links, kept until there is a journal to write them to.

    It begins before the journal does: a run that was refused leaves no file.
    """

    def __init__(self) -> None:
        self._journal: Journal | None = None
        self._kept: list[tuple[str, Mapping[str, object]]] = []

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Write one incident, or keep it; as `Journal.record`."""
        if self._journal is not None:
            self._journal.record(kind, fields)
        elif len(self._kept) < MOST_INCIDENTS:
            self._kept.append((kind, fields))

    def hand_over(self, journal: Journal) -> None:
        """Write what was kept, as `Journal.record` does; from now on write at once."""
        self._journal = journal
        for kind, fields in self._kept:
            journal.record(kind, fields)
        self._kept.clear()


def verify(path: Path) -> Verified:
    """Check every line of a journal: whole, numbered, chained, its tables intact; or JournalError."""
    with _reading(path) as file:
        seen = _verified(path, file)
    if not seen.records:
        raise JournalError(path, "is empty")
    return seen


def _verified(path: Path, file: BinaryIO, *, torn: bool = False) -> Verified:
    seen = Verified()
    for entry, length in _chain(path, file, torn=torn):
        begins = entry["kind"] == "header"
        if seen.closed and not begins:
            told = "does not belong to a run; a header was expected"
            raise JournalError(path, told, seen.records + 1)
        seen = Verified(
            str(entry["digest"]),
            seen.records + 1,
            seen.size + length,
            seen.runs + begins,
            entry["kind"] == "end",
        )
    return seen


def records(path: Path) -> Iterator[dict[str, object]]:
    """The records of a journal, each checked against the chain before it is given out.

    Raises:
        JournalError: the file cannot be read, or naming the first line that does not verify.
    """
    with _reading(path) as file:
        for entry, _ in _chain(path, file):
            yield entry


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise JournalError(path, f"cannot be read: {error.strerror}") from error


def _chain(path: Path, file: BinaryIO, *, torn: bool = False) -> Iterator[tuple[dict[str, object], int]]:
    """Each record with the length of its line; `torn` lets the file end with the beginning of one."""
    head = GENESIS
    for number in count(1):
        line = file.readline(MAX_LINE_BYTES)
        if not line or (torn and _is_begun(line, number) and not file.read(1)):
            return
        entry = _checked(path, number, line, head)
        head = str(entry["digest"])
        yield entry, len(line)


def _is_begun(line: bytes, number: int) -> bool:
    """Whether a line may be a record cut short by a crash; a file system may fill its end with zeros."""
    opening = OPENING + b'%d,"time":"' % (number - 1)
    if line.endswith(b"\n"):
        return False
    left = line.rstrip(b"\0")
    return left.startswith(opening) or (number > 1 and opening.startswith(left))


def _checked(path: Path, number: int, line: bytes, previous: str) -> dict[str, object]:
    if _is_begun(line, number) or (line.startswith(OPENING) and not line.endswith(b"\n")):
        raise TornError(path, "cut short; the run ended while it was written", number)
    intact = is_intact(line)
    if intact is None:
        raise JournalError(path, "is no record of a journal", number)
    if not intact:
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
        _check_header(path, number, entry)
    return entry


def _check_header(path: Path, number: int, entry: Mapping[str, object]) -> None:
    if entry.get("journal_version") != VERSION:
        raise JournalError(path, f"is not a header of journal version {VERSION}", number)
    try:
        table = base64.b64decode(str(entry.get("table_base64")), validate=True)
    except ValueError:
        raise JournalError(path, "the embedded table is not base64", number) from None
    if hashlib.sha256(table).hexdigest() != entry.get("table_sha256"):
        raise JournalError(path, "the embedded table is not the one of its digest", number)


def _write_all(file: int, data: bytes) -> None:
    while data:
        data = data[os.write(file, data) :]


def _opened(path: Path) -> int:
    """A descriptor of a regular file, made if need be and never reached through a link."""
    with contextlib.suppress(FileNotFoundError):
        _check_regular(path, path.lstat().st_mode)
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    file = os.open(path, flags, 0o644)
    try:
        _check_regular(path, os.fstat(file).st_mode)
    except JournalError:
        os.close(file)
        raise
    return file


def _check_regular(path: Path, mode: int) -> None:
    if reason := oddity(mode):
        raise JournalError(path, f"cannot be written: {reason}; name another file")


def _unwritable(path: Path, error: OSError) -> JournalError:
    remedy = "make its folder" if isinstance(error, FileNotFoundError) else "free the disk"
    return JournalError(path, f"cannot be written: {error.strerror}; {remedy} or name another file")
