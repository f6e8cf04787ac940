"""The status of a run that has begun no part yet."""

from runtime.monitoring.shift import CHANGES, Shift
from runtime.monitoring.status import Status
from runtime.table import Table, TableFile


def status_of(table: Table, name: str, takt_s: float | None = None) -> Status:
    return Status(name, TableFile(table, b"", "ab" * 32), Shift(CHANGES, takt_s))
