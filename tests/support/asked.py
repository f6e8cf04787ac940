"""The decision server without its socket: answers the lines of a robot in memory."""

from dataclasses import replace
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
    """Returns an `AskedParts`, which answers a robot's lines from a table.

    Unless they are given, the journal and the clock are fakes. `count` limits the number of parts.
    """
    return AskedParts(
        table,
        "0" * 64,
        journal or FakeJournal(),
        clock or FakeClock(),
        Objects(table, Path("j")),
        Tally(),
        replace(options or RunOptions(), count=count),
    )
