"""The log of what was installed in a cell and when: a journal beside the runs' journal.

Each of its records embeds a table and says which calibration, versions and signature went with it. One is
added when a run begins with anything else than the last one says, so that a run leaves the log as it is as
long as nothing has changed. Chain, locks and segments are the journal's, and `grasp-journal` reads it.
"""

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from runtime.journal.chain import Journal
from runtime.journal.lines import RESERVED, UPTIME

_TABLE = frozenset({"journal_version", "table_base64"})


def log_of(journal: Path) -> Path:
    """The log beside a journal."""
    return journal.with_name(f"{journal.name}.installed")


def note(
    journal: Path,
    table: bytes,
    fields: Mapping[str, object],
    stamp: Callable[[], str],
    uptime: Callable[[], Mapping[str, object]],
) -> bool:
    """Add what a run is about to use to the log, unless it says so already; whether it was added.

    Args:
        journal: of the run; the log is `log_of` it.
        table: the table's bytes.
        fields: what else is installed, as JSON holds it.
        stamp: dates a record: `SystemClock.stamp`.
        uptime: as for `Journal`: `SystemClock.uptime`.

    Raises:
        JournalError: the log cannot be written, or was changed.
    """
    with Journal(log_of(journal), stamp, uptime) as log:
        installed = {**fields, "table_sha256": hashlib.sha256(table).hexdigest()}
        last = log.last_part[0] if log.last_part else {}
        ours = RESERVED | UPTIME | _TABLE
        if {name: value for name, value in last.items() if name not in ours} == installed:
            return False
        log.header(table, fields)
        log.record("end", {})
    return True
