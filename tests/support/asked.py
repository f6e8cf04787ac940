"""Parts of a robot that asks, in memory."""

from pathlib import Path

from fake_cell import FakeClock, FakeJournal

from runtime.devices.clock import SystemClock
from runtime.execution.asked import AskedParts
from runtime.execution.events import Tally
from runtime.execution.executor import RunOptions
from runtime.monitoring.console import Objects
from runtime.table import Table


def asked_parts(
    table: Table,
    options: RunOptions | None = None,
    journal: FakeJournal | None = None,
    clock: SystemClock | None = None,
    count: int | None = None,
) -> AskedParts:
    """What answers a robot's lines by a table."""
    console, options = Objects(table, Path("j")), options or RunOptions()
    kept = (journal or FakeJournal(), clock or FakeClock())
    return AskedParts(table, "0" * 64, *kept, console, Tally(), options, count)
