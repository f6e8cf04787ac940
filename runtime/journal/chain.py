"""The journal of a run: append-only JSON lines, chained by their digests.

A line's last field, `digest`, is the SHA-256 of the line without that field; `previous` is the digest of the
line before. So a changed, missing or inserted line is detected.

A record is on the disk when `Journal.record` returns. A run begins with a record of kind `header`, which
embeds the table: the file alone is enough to check every decision. A run ends with a record of kind `end`; a
run without it broke off. Between the two are records of these kinds:

- for each part: `part`; `turned` if its plan was turned; `pushing` if a push precedes a squeeze; `placed` and
  `squeeze` for each squeeze; `audit` and `delivery` where there is one; `outcome`; and `truth`, the true pose
  of a simulated part;
- before a part that a PLC requested: `trigger`, whose field `part` is null if the request was withdrawn
  before anything moved;
- after a crash: `resume` and `freed`;
- in a run without parts: `put_down`;
- anywhere: `link`, a retry or a failure of the communication with the gripper.

A long file is ended between two parts with a record of kind `seal`. The chain continues in a new file, which
begins with the run's header again, extended by `after_part`, the number of the last part. So the latest file
is enough to know the state of the last run, however long the journal is.
"""

import base64
import contextlib
import hashlib
import json
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Self

from runtime.errors import JournalError
from runtime.journal import files
from runtime.journal.files import write_all as _write_all
from runtime.journal.lines import RESERVED, VERSION, Entry, Verified, content_of, follow
from runtime.shell import interrupts
from runtime.shell.sealed_lines import sealed, sealed_segments

SEGMENT_BYTES = 8 << 20  # length of a file's records, its header left out, from which it is sealed
# most incidents kept until there is a journal; of a very bad link the first ones are enough
MOST_INCIDENTS = 1000


class Journal:
    """A journal being written. An existing journal is verified from its last seal on, and continued.

    An incomplete last line is cut off: `record` never returned for it, so nothing was done because of it. A
    file with any other fault is left unchanged.

    Before each record the place and the length of the file are checked. If the file was removed, renamed,
    replaced, truncated or extended, the record is refused, since the next run might not see it. All later
    records then go to another file, `files.broken_of`; the earlier ones are copied there first, unless the
    journal was truncated. While that file exists, no run continues the journal.
    """

    def __init__(
        self,
        path: Path,
        stamp: Callable[[], str],
        uptime: Callable[[], Mapping[str, object]] = dict,
        segment_bytes: int = SEGMENT_BYTES,
    ) -> None:
        """Opens and locks the file for writing; a missing file is created, an existing one verified.

        Args:
            path: the file.
            stamp: returns the present date, for a record: `SystemClock.stamp`.
            uptime: returns the present time by a clock that nobody can set: `SystemClock.uptime`.
            segment_bytes: length at which the file is sealed, its first record not counted.

        Raises:
            JournalError: the file cannot be opened, another process writes it, or its content does not
                verify.
        """
        self.path = path
        self.cut_bytes = 0  # length of the incomplete line that was cut off
        # The last run's header and the records of its last part, when the journal was opened.
        self.last_part: list[Entry] = []
        self.common: dict[str, object] = {}  # further fields of every header
        self.stamp, self.uptime, self._segment_bytes = stamp, uptime, segment_bytes
        self._place = path  # path of the file being written
        self._header: Mapping[str, object] = {}  # the fields of the run's header
        self._full_bytes = segment_bytes  # length above which the file is sealed
        self._failed = False
        self._file = -1
        try:
            self._file = files.claim(path)
            self._end = self._verify()
        except OSError as error:
            self.close()
            raise _unwritable(path, error) from error
        except BaseException:  # Ctrl-C, too, must not leave the file claimed
            self.close()
            raise

    def _verify(self) -> Verified:
        """Verifies the file, then cuts off an incomplete last line; returns the state at its end."""
        start = end = files.start_of(self.path)
        with open(self._file, "rb", closefd=False) as file:
            for entry, end in follow(self.path, file, start, torn=True):
                self._remember(entry, end.size)
            size = file.seek(0, os.SEEK_END)
        if start.segments and not end.size:
            raise JournalError(
                self.path, "is empty, and comes after a sealed segment; put its records back"
            )
        self.cut_bytes = size - end.size
        if self.cut_bytes:
            os.ftruncate(self._file, end.size)
            os.fsync(self._file)
        return end

    def _remember(self, entry: Entry, size: int) -> None:
        """Derives from one record of an existing file what the journal must know to continue the file.

        Updates the run's header, the records `last_part`, and the length at which the file is sealed.

        Args:
            entry: the record.
            size: length of the file up to the end of the record.
        """
        if not self.last_part:
            self._full_bytes = size + self._segment_bytes
        if entry["kind"] == "header":
            self._header = content_of(entry)
            self.last_part = [entry]
        elif entry["kind"] == "part":
            self.last_part = [*self.last_part[:1], entry]
        else:
            self.last_part.append(entry)

    @property
    def head(self) -> str:
        """Digest of the last record."""
        return self._end.head

    def now(self) -> dict[str, object]:
        """The fields `time`, `boot` and `up_s` that a record written now would have."""
        return {"time": self.stamp(), **self.uptime()}

    def header(self, table: bytes, fields: Mapping[str, object]) -> None:
        """Writes the first record of a run: the table's bytes, their digest, and the run's other fields.

        Raises:
            JournalError: the record cannot be written.
        """
        embedded = {
            "journal_version": VERSION,
            "table_sha256": hashlib.sha256(table).hexdigest(),
            "table_base64": base64.b64encode(table).decode("ascii"),
        }
        self.record("header", {**fields, **self.common, **embedded})

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Appends one record and writes it to the disk.

        Raises:
            JournalError: the record cannot be written: the disk is full or gone, the journal is closed, or
                the file was moved or changed.
            ValueError: a field has a reserved name, or holds a number that JSON cannot represent.
        """
        if clash := RESERVED & fields.keys():
            raise ValueError(f"reserved field names: {sorted(clash)}")
        self._check()
        full = self._end.size >= self._full_bytes and self._place == self.path
        if kind == "header":
            self._header = fields
            if full:
                self._rotate(fields)
                return
        if full and kind == "part" and self._header:
            self._rotate({**self._header, "after_part": int(str(fields["part"])) - 1})
        self._append(kind, fields)

    def _check(self) -> None:
        """Checks that the file is still at its place, with the length that was written.

        Raises:
            JournalError: the file was moved or changed, or an earlier record could not be written.
        """
        if self._failed:
            raise JournalError(
                self.path,
                "could not be written before, and what it holds since is not known; free the disk or name "
                "another file",
            )
        try:
            reason = files.displacement(self._place, self._file, self._end.size)
        except OSError as error:
            self._failed = True
            raise _unwritable(self.path, error) from error
        if reason:
            raise JournalError(
                self.path, f"was {reason} while it was written; {self._keep_apart()}"
            )

    def _keep_apart(self) -> str:
        """Redirects further records to `files.broken_of`; returns, as text, what that file holds."""
        before = self._file
        self._failed = True
        try:
            self._file, size = files.copy_aside(self.path, before, self._end.size)
        except OSError as error:
            return (
                f"what the run records now is lost: {files.broken_of(self.path)}: {error.strerror}"
            )
        os.close(before)
        self._place, self._failed = files.broken_of(self.path), False
        self._end = self._end._replace(size=size)
        which = "all that it held and what follows is" if size else "what follows is"
        return f"{which} in {self._place} (runtime/OUTCOMES.md says how to go on)"

    def _append(self, kind: str, fields: Mapping[str, object]) -> None:
        line, digest = self._line(kind, fields)
        end = self._end
        if not end.size:
            self._full_bytes = len(line) + self._segment_bytes
        try:
            _write_all(self._file, line)
            os.fsync(self._file)
            size = end.size + len(line)
            # One assignment: a stop request comes before or after it, never in between.
            self._end = end._replace(head=digest, records=end.records + 1, size=size)
        except OSError as error:
            self._failed = True  # a failed sync cannot be repeated
            self._take_back()
            raise _unwritable(self.path, error) from error
        except BaseException:  # a stop request
            self._take_back()
            raise

    def _line(self, kind: str, fields: Mapping[str, object]) -> tuple[bytes, str]:
        frame = {"seq": self._end.records, **self.now(), "kind": kind}
        entry = {**frame, **fields, "previous": self._end.head}
        return sealed(json.dumps(entry, separators=(",", ":"), allow_nan=False).encode("ascii"))

    def _rotate(self, header: Mapping[str, object]) -> None:
        """Seals the file, which becomes a segment, and starts a new file with the fields of a header."""
        with interrupts.whole():
            number = self._end.segments + 1
            self._append("seal", {"segment": number})
            line, digest = self._line("header", header)
            before = self._file
            try:
                self._file = files.rotate(self.path, before, number, line)
            except OSError as error:
                self._failed = True
                raise _unwritable(self.path, error) from error
            os.close(before)
            self._end = Verified(digest, self._end.records + 1, len(line), segments=number)
            self._full_bytes = len(line) + self._segment_bytes

    def _take_back(self) -> None:
        """Truncates the file to its complete records, after a write that failed or was interrupted."""
        with contextlib.suppress(OSError):
            if os.fstat(self._file).st_size > self._end.size:
                os.ftruncate(self._file, self._end.size)

    def close(self) -> None:
        """Closes the file; nothing can be recorded afterwards. Idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Incidents:
    """Writes retries and failures of the drivers' links to a journal, and keeps them until there is one.

    The devices are connected before the run is recorded, since a refused run must leave no record. Of the
    incidents until then the first `MOST_INCIDENTS` are kept.
    """

    def __init__(self) -> None:
        self._journal: Journal | None = None
        self._kept: list[tuple[str, Mapping[str, object]]] = []

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Writes one incident to the journal, see `Journal.record`, or keeps it until there is a journal."""
        if self._journal is not None:
            self._journal.record(kind, fields)
        elif len(self._kept) < MOST_INCIDENTS:
            self._kept.append((kind, fields))

    def hand_over(self, journal: Journal) -> None:
        """Writes the kept incidents to a journal (`Journal.record`); later incidents are written at once."""
        self._journal = journal
        for kind, fields in self._kept:
            journal.record(kind, fields)
        self._kept.clear()


def verify(path: Path) -> Verified:
    """Checks that all lines of a journal are complete, numbered and chained, and that its tables are intact.

    Returns:
        The state of the journal after its last line.

    Raises:
        JournalError: a line does not verify, a segment is missing, or the journal is empty.
    """
    sealed_before = files.check_whole(path)
    latest = deque(_followed(path), maxlen=1)
    if not latest or latest[0][1].segments < len(sealed_before):
        raise JournalError(path, "is empty")
    return latest[0][1]


def records(path: Path) -> Iterator[dict[str, object]]:
    """The records of a journal, each checked against the chain before it is yielded.

    Raises:
        JournalError: a file cannot be read, or a line does not verify; the message names the first one.
    """
    for entry, _ in _followed(path):
        yield entry


def _followed(path: Path) -> Iterator[tuple[dict[str, object], Verified]]:
    """The records of all segments, each with the state of the journal after it."""
    seen = Verified()
    try:
        with path.open("rb") as latest:
            for number, segment in enumerate(sealed_segments(path), 1):
                with segment.open("rb") as file:
                    if os.path.sameopenfile(file.fileno(), latest.fileno()):
                        break  # sealed since it was opened
                    for entry, after in follow(segment, file, seen):
                        seen = after
                        yield entry, after
                seen = seen._replace(size=0, segments=number)
            yield from follow(path, latest, seen)
    except OSError as error:
        raise JournalError(path, f"cannot be read: {error.strerror}") from error


def _unwritable(path: Path, error: OSError) -> JournalError:
    remedy = "make its folder" if isinstance(error, FileNotFoundError) else "free the disk"
    return JournalError(path, f"cannot be written: {error.strerror}; {remedy} or name another file")
