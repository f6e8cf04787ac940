"""Who watches a run: the console, the status socket and the service manager, told of the same events."""

import hashlib
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from runtime import watchdog
from runtime.console import Console, Sighting
from runtime.phases import Phase
from runtime.results import PartResult, Step
from runtime.status import Status, StatusServer
from runtime.table import Table, dumps
from runtime.tally import Tally


class Monitor:
    """A console that also keeps the status and the watchdog; the context is the time the run takes.

    Args:
        console: told everything.
        table: for the status.
        name: what the table is called.
        socket: where the status is told, None for nowhere.
    """

    def __init__(self, console: Console, table: Table, name: Path, socket: Path | None) -> None:
        self._console = console
        self._status = Status(
            str(name), hashlib.sha256(dumps(table)).hexdigest(), table.predicted.success_ppm
        )
        self._socket = socket
        self._stack = ExitStack()

    def note(self, sentence: str) -> None:
        """Something the reader should know."""
        self._console.note(sentence)

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        """A change of phase."""
        self._status.phase(part, phase, node)
        watchdog.alive(part, phase, node)

    def step(self, part: int, step: Step) -> None:
        """One squeeze."""
        self._status.step(step)
        self._console.step(part, step)

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """One part's end."""
        self._status.part(result)
        self._console.part(result, seen)

    def summary(self, tally: Tally, journal: Path) -> None:
        """The run's end."""
        self._console.summary(tally, journal)

    def __enter__(self) -> Self:
        if self._socket is not None:
            self._stack.enter_context(StatusServer(self._socket, self._status))
        watchdog.notify(watchdog.READY)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        watchdog.notify(watchdog.STOPPING)
        self._stack.close()
