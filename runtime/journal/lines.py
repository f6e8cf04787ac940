"""The lines of a journal, each checked against those before it."""

import base64
import hashlib
from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import BinaryIO, NamedTuple

from runtime.errors import JournalError, TornError
from runtime.shell import strict_json
from runtime.shell.sealed_lines import GENESIS, is_intact

VERSION = 1
MAX_LINE_BYTES = 8 << 20
OPENING = b'{"seq":'
RESERVED = frozenset({"seq", "time", "kind", "previous", "digest"})  # fields of every record
UPTIME = frozenset({"boot", "up_s"})  # further fields on machines that provide them


Entry = Mapping[str, object]


class Verified(NamedTuple):
    """State of a verified journal after one of its records: digest, counts, and whether the run ended."""

    head: str = GENESIS  # digest of the last record, which the next one has to hold
    records: int = 0  # number of records
    size: int = 0  # length of the records in the journal's current file, bytes
    runs: int = 0  # number of runs, each begun by a header
    closed: bool = True  # whether the last run wrote its last record
    segments: int = 0  # number of sealed segments before the journal's current file

    def after(self, entry: Entry, length: int) -> "Verified":
        """The state after one more record, whose line has `length` bytes."""
        return self._replace(
            head=str(entry["digest"]),
            records=self.records + 1,
            size=self.size + length,
            runs=self.runs + begins_run(entry),
            closed=self.closed if entry["kind"] == "seal" else entry["kind"] == "end",
        )


def content_of(entry: Entry) -> dict[str, object]:
    """The fields of a record without those that every record has, such as `seq` and `time`."""
    return {name: value for name, value in entry.items() if name not in RESERVED | UPTIME}


def begins_run(entry: Entry) -> bool:
    """Whether a record begins a run: it is a header, but not one that continues a run in a new file."""
    return entry["kind"] == "header" and "after_part" not in entry


def follow(
    path: Path, file: BinaryIO, seen: Verified, *, torn: bool = False
) -> Iterator[tuple[dict[str, object], Verified]]:
    """Yields the records of an open file, each with the state of the journal after it.

    Args:
        path: the file's name, for errors.
        file: the file, at its beginning.
        seen: state of the journal before the file's first record.
        torn: whether the file may end with an incomplete record, which is then left out.

    Raises:
        JournalError: a line does not verify; the message names the first one.
    """
    for number in count(1):
        line = file.readline(MAX_LINE_BYTES)
        if not line or (torn and is_begun(line, seen.records) and not file.read(1)):
            return
        entry = checked(path, number, line, seen.records, seen.head)
        if seen.closed and entry["kind"] not in ("header", "seal"):
            raise JournalError(path, "does not belong to a run; a header was expected", number)
        seen = seen.after(entry, len(line))
        yield entry, seen


def is_begun(line: bytes, seq: int) -> bool:
    """Whether a line may be the beginning of a record that a crash cut short.

    A file system may have filled the end of the line with zero bytes. `seq` is the expected sequence number.
    """
    opening = OPENING + b'%d,"time":"' % seq
    if line.endswith(b"\n"):
        return False
    left = line.rstrip(b"\0")
    return left.startswith(opening) or (seq > 0 and opening.startswith(left))


def checked(path: Path, number: int, line: bytes, seq: int, previous: str) -> dict[str, object]:
    """Parses and checks the record of a line.

    Args:
        path: the file.
        number: number of the line in the file, from 1.
        line: the line, including its line break.
        seq: the expected sequence number.
        previous: digest of the line before.

    Raises:
        TornError: the line is incomplete.
        JournalError: the line is no valid record, or not the one that follows the line before.
    """
    if is_begun(line, seq) or (line.startswith(OPENING) and not line.endswith(b"\n")):
        raise TornError(path, "cut short; the run ended while it was written", number)
    intact = is_intact(line)
    if intact is None:
        raise JournalError(path, "is no record of a journal", number)
    if not intact:
        raise JournalError(
            path, "does not have its digest; it was changed after it was written", number
        )
    try:
        entry = strict_json.parse(line)
    except ValueError as error:
        raise JournalError(path, f"is {error}", number) from None
    if not isinstance(entry, dict) or not entry.keys() >= RESERVED:
        raise JournalError(path, f"lacks one of {', '.join(sorted(RESERVED))}", number)
    if type(entry["seq"]) is not int or entry["seq"] != seq:
        remedy = "; the records before it are missing" if number == 1 else ""
        raise JournalError(
            path, f"has sequence number {entry['seq']}, expected {seq}{remedy}", number
        )
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
