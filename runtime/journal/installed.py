"""Log of what was installed in a cell, and when: a journal beside the runs' journal.

Each entry is a header that embeds a table, and states calibration, versions and signature. A run adds an
entry only if something differs from the last entry. The log has the chain, locks and segments of a journal,
and `grasp-journal` reads it.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from runtime.journal.chain import Journal
from runtime.journal.lines import content_of

_TABLE = frozenset({"journal_version", "table_base64"})


def log_of(journal: Path) -> Path:
    """Path of the log of installations that belongs to a journal."""
    return journal.with_name(f"{journal.name}.installed")


def note(journal: Journal, table: bytes, fields: Mapping[str, object]) -> bool:
    """Logs what a run uses, unless the log's last entry states the same; returns whether an entry was added.

    Args:
        journal: the run's journal; the log is in the file `log_of`, and uses the journal's clocks.
        table: the table's bytes.
        fields: what else is installed, in the form of JSON.

    Raises:
        JournalError: the log cannot be written, or was changed.
    """
    with Journal(log_of(journal.path), journal.stamp, journal.uptime) as log:
        installed = {**fields, "table_sha256": hashlib.sha256(table).hexdigest()}
        last = content_of(log.last_part[0]) if log.last_part else {}
        if {name: value for name, value in last.items() if name not in _TABLE} == installed:
            return False
        log.header(table, fields)
        log.record("end", {})
    return True
