"""Log of what was installed in a cell, and when: a journal beside the runs' journal.

Each entry is a header that embeds a table, and states calibration, versions and signature. A run adds an
entry only if something differs from the last entry. The log has the chain, locks and segments of a journal,
and `grasp-journal` reads it. The header of each run has the digest of the log's last record, so that the next
run notices if records are missing.
"""

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from runtime.errors import JournalError, TornError
from runtime.journal.chain import Journal, records
from runtime.journal.lines import content_of

_TABLE = frozenset({"journal_version", "table_base64"})


def log_of(journal: Path) -> Path:
    """Path of the log of installations that belongs to a journal."""
    return journal.with_name(f"{journal.name}.installed")


def note(journal: Journal, table: bytes, fields: Mapping[str, object]) -> bool:
    """Logs what a run uses, unless the log's last entry states the same; returns whether an entry was added.

    Later headers of the journal have the digest of the log's last record as `installed`.

    Args:
        journal: the run's journal; the log is in the file `log_of`, and uses the journal's clocks.
        table: the table's bytes.
        fields: what else is installed, in the form of JSON.

    Raises:
        JournalError: the log cannot be written, was changed, or lacks records that it had at the last run.
    """
    path = log_of(journal.path)
    _check_whole(path, journal.last_part[0].get("installed") if journal.last_part else None)
    with Journal(path, journal.stamp, journal.uptime) as log:
        installed = {**fields, "table_sha256": hashlib.sha256(table).hexdigest()}
        last = content_of(log.last_part[0]) if log.last_part else {}
        new = {name: value for name, value in last.items() if name not in _TABLE} != installed
        if new:
            log.header(table, fields)
            log.record("end", {})
        journal.common["installed"] = log.head
    return new


def _check_whole(log: Path, head: object) -> None:
    """Checks that a log still has the record with the digest `head`; None: no run has noted one."""
    digests = set[object]()
    with suppress(TornError):  # no run has seen a record that is cut off
        if log.exists():
            digests.update(entry["digest"] for entry in records(log))
    if head is not None and head not in digests:
        raise JournalError(
            log, "lacks records that the last run saw; put them back, or move all away"
        )
