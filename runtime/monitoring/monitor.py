"""Passes the events of a run to its observers: console, live page, service manager."""

import os
import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple, Self

from runtime.devices.clock import SystemClock
from runtime.execution.events import Console, Phase, Sighting, Tally
from runtime.monitoring.shift import CHANGES, Shift
from runtime.monitoring.status import Status
from runtime.shell.command import sentence_of
from runtime.table import TableFile
from runtime.traversal.results import Outcome, PartResult, Step

FAREWELL_S = 1.0  # time for a page in a browser to request the status once more after the run's end
SENT_S = 0.1  # time for the response to be sent


class Views(NamedTuple):
    """Options of a run's status and of the run's live page."""

    http: str | None = None  # address of the live page, `HOST:PORT`
    takt_s: float | None = None  # time within which a part should be done
    shifts: tuple[int, ...] = CHANGES  # hours of the day at which shifts change
    journal: Path | None = None  # journal of earlier runs, whose parts belong to the shift


class Monitor(Console):
    """Passes the events of a run to a console, to the run's status and to the service manager.

    Used as a context, the monitor also serves the live page if `Views.http` names an address. Only then the
    page's modules are loaded.
    """

    def __init__(
        self, console: Console, loaded: TableFile, name: Path, views: Views | None = None
    ) -> None:
        self._console, self._table, self._name = console, loaded.table, str(name)
        self._views = views or Views()
        shift = Shift(self._views.shifts, self._views.takt_s)
        if self._views.http is not None and self._views.journal is not None:
            shift.recall(self._views.journal, loaded.digest)
        self._status = Status(self._name, loaded, shift)
        self._stack = ExitStack()

    def ready(self) -> None:
        """Notifies the service manager that the devices have answered and that the run begins."""
        notify("READY=1")

    def note(self, sentence: str) -> None:
        """Passes a message to the console."""
        self._console.note(sentence)

    def phase(self, part: int, phase: Phase, node: int | None) -> None:
        """Records a change of phase in the status, and notifies the service manager's watchdog.

        The run's own thread calls this. If the run hangs in a device, no notification is sent, and the
        service manager ends the process. So `WatchdogSec` has to be longer than the longest phase.
        """
        self._status.phase(part, phase, node)
        where = "" if node is None else f", node {node}"
        notify("WATCHDOG=1", f"STATUS=part {part}: {phase.value}{where}")

    def step(self, part: int, step: Step) -> None:
        """Passes a squeeze to the status and the console."""
        self._status.step(step)
        self._console.step(part, step)

    def part(self, result: PartResult, seen: Sighting | None) -> None:
        """Passes the result of a part to the status and the console."""
        self._status.part(result)
        self._console.part(result, seen)

    def summary(self, tally: Tally, journal: Path) -> None:
        """Passes the totals of the run to the status and the console, at the run's end."""
        self._status.end(*ended(tally))
        self._console.summary(tally, journal)

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            if self._views.http is not None:
                self._serve(self._views.http, opened)
            self._stack = opened.pop_all()
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, KeyboardInterrupt):
            self._status.end("fair", "Stopped by the operator.")
        elif error is not None:
            self._status.end("poor", f"Ended by an error: {sentence_of(error)}")
        notify("STOPPING=1")
        self._stack.close()

    def _serve(self, text: str, stack: ExitStack) -> None:
        from runtime.monitoring.live import page
        from runtime.monitoring.live.server import PageServer, parse

        pages = page.pages(self._table, Path(self._name).name, self._status)
        server = stack.enter_context(PageServer(parse(text), pages))
        stack.callback(self._say_goodbye)
        open_to = "" if server.local else ", for everybody who reaches this machine"
        self._console.note(f"live page: http://{server.address}/{open_to}")

    def _say_goodbye(self) -> None:
        """If a page is open in a browser, waits up to `FAREWELL_S` until the page has read how the run ended.

        Without the wait the page could not distinguish the run's end from a lost connection.
        """
        watched = self._status.watched
        if not watched.is_set():
            return
        watched.clear()
        if watched.wait(FAREWELL_S):
            SystemClock().sleep(SENT_S)


def ended(tally: Tally) -> tuple[str, str]:
    """Describes how a run ended, for `Status.end`: a grade ("good", "fair" or "poor") and a sentence."""
    count, located = tally.parts, tally.outcomes[Outcome.LEAF]
    figures = f"{count} part{'s' * (count != 1)}, {located} located"
    if tally.outcomes[Outcome.FAULT]:
        return "poor", f"Stopped by a fault. {figures}."
    if tally.outcomes[Outcome.ABORTED]:
        return "poor", f"A part was given up. {figures}."
    if tally.outcomes[Outcome.STOPPED]:
        return "fair", f"Stopped by the operator. {figures}."
    return "good", f"Ended as planned. {figures}."


def notify(*lines: str) -> None:
    """Sends lines such as "READY=1" to the service manager (sd_notify(3)), if it started this process."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return
    # A leading @ stands for the zero byte with which Linux' abstract socket names begin.
    name = "\0" + address[1:] if address.startswith("@") else address
    kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC
    with suppress(OSError), socket.socket(socket.AF_UNIX, kind) as channel:
        channel.setblocking(False)  # does not wait for a service manager that hangs
        channel.connect(name)
        channel.sendall("\n".join(lines).encode())
