"""The server of one robot: its time limits, and the options that contradict it."""

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
    """A clock that gives every deadline a tenth of a second."""

    def deadline(self, seconds: float) -> float:
        return self.now() + 0.1


class Serving:
    """A server in a thread; it ends after `parts` parts."""

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
        """All lines that a robot receives if it sends `data` and waits for the end."""
        robot = socket.create_connection(self.address, timeout=30)
        with robot, robot.makefile("r") as lines:
            robot.sendall(data)
            return [line.rstrip("\n") for line in lines]

    def ended(self) -> list[tuple[str, dict[str, object]]]:
        self._thread.join(30)
        return self.journal.kept


def test_serve_slow_squeeze_is_aborted():
    serving = Serving(FakeJournal(), ShortLived())
    squeeze, late = serving.lines(b"NEXT\n")
    assert (squeeze.split()[0], late) == ("SQUEEZE", refused(31))
    kind, outcome = serving.ended()[-1]
    assert (kind, outcome["outcome"]) == ("outcome", "aborted")
    assert outcome["reason"] == "the robot did not answer in time"


def test_serve_incomplete_line_is_refused_in_time(monkeypatch):
    monkeypatch.setattr(serve, "PATIENCE_S", 0.2)
    serving = Serving(FakeJournal(), ShortLived())
    assert serving.lines(b"NEX") == [refused(14)]
    serving.lines(b"NEXT\n")
    serving.ended()


def test_serve_unwritable_journal_is_reported_and_ends_server():
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
def test_check_usage_options_contradicting_serve_are_refused(words, message):
    with pytest.raises(UsageError, match=message):
        options.check_usage(parser().parse_args([*SERVE, *words.split()]))
