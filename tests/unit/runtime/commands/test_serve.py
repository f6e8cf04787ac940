"""The server of one robot: what happens when time passes, and which options go with it."""

import socket
import threading
from pathlib import Path

import pytest
from asked import asked_parts
from fake_cell import FakeJournal
from sample_tables import small_table

from runtime.commands import options, serve
from runtime.commands.arguments import parser
from runtime.devices.clock import SystemClock
from runtime.errors import JournalError
from runtime.execution.asked import refused
from runtime.monitoring.live.server import Address, listening
from runtime.shell.errors import UsageError

SERVE = ["--tree", "t", "--serve", "tcp://127.0.0.1:5020"]


class ShortLived(SystemClock):
    """Gives a squeeze a tenth of a second."""

    def deadline(self, seconds: float) -> float:
        return self.now() + 0.1


class Serving:
    """A server in a thread; it ends once `parts` are over."""

    def __init__(self, journal: FakeJournal, clock: SystemClock, parts: int = 1) -> None:
        self.journal, self.raised = journal, None
        listener = listening(Address("127.0.0.1", 0), "--serve")
        self.address = listener.getsockname()
        asked = asked_parts(small_table(), None, journal, clock, parts)
        self._server = serve.RobotServer(listener, asked, clock)
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        try:
            self._server.serve()
        except JournalError as error:
            self.raised = error

    def lines(self, data: bytes) -> list[str]:
        """All lines that a robot hears which says this and waits for the end."""
        robot = socket.create_connection(self.address, timeout=30)
        with robot, robot.makefile("r") as lines:
            robot.sendall(data)
            return [line.rstrip("\n") for line in lines]

    def ended(self) -> list[tuple[str, dict[str, object]]]:
        self._thread.join(30)
        return self.journal.kept


def test_serve_gives_up_a_squeeze_that_takes_too_long():
    serving = Serving(FakeJournal(), ShortLived())
    squeeze, late = serving.lines(b"NEXT\n")
    assert (squeeze.split()[0], late) == ("SQUEEZE", refused(31))
    kind, outcome = serving.ended()[-1]
    assert (kind, outcome["outcome"]) == ("outcome", "aborted")
    assert outcome["reason"] == "the robot did not answer in time"


def test_serve_does_not_wait_for_half_a_line(monkeypatch):
    monkeypatch.setattr(serve, "PATIENCE_S", 0.2)
    serving = Serving(FakeJournal(), ShortLived())
    assert serving.lines(b"NEX") == [refused(14)]
    serving.lines(b"NEXT\n")
    serving.ended()


def test_serve_reports_a_journal_that_cannot_be_written_and_ends():
    serving = Serving(FakeJournal(1, JournalError(Path("j"), "cannot be written")), SystemClock())
    assert serving.lines(b"NEXT\n") == [refused(41)]
    assert serving.ended() == [("part", {"part": 1})]
    assert serving.raised is not None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--port sim", "leave out --port"),
        ("--arm tcp://x:1", "leave out --arm"),
        ("--after-crash resume", "leave out --after-crash"),
        ("--deliver 1,2,3", "leave out --deliver"),
        *((f"--serve {bad}", "write") for bad in ("5020", "udp://h:1", "tcp://127.0.0.1:99999")),
        *((f"--serve tcp://{host}:5020", "add --network") for host in ("0.0.0.0", "192.168.1.2")),
    ],
)
def test_serve_refuses_options_that_do_not_go_with_it(words, message):
    with pytest.raises(UsageError, match=message):
        options.check_usage(parser().parse_args([*SERVE, *words.split()]))
