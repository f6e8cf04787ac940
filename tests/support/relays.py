"""Relays between a run and its devices: they count the calls, and change the answers from one call on."""

import contextlib
import os
import select
import socket
import termios
import threading
import time
import tty
from typing import NamedTuple

MODES = ("silent", "slow", "drip", "endless", "stopped", "gone")
SLOW_S, DRIP_S = 0.2, 0.1
# Bytes that an endless device sends, and the time until it sends them again. More bytes would keep two cores
# busy, one with the relay and one with the run.
FLOOD, FLOOD_S = os.urandom(1 << 16), 0.005


class Case(NamedTuple):
    """A device, the mode into which it changes, and the call of the run at which it changes.

    How often a run polls depends on the machine's load. Therefore a call is identified by its row (see
    `Rows`) and its number in the row, both from 0. If the row has fewer calls, the device changes at the
    first call of the next row.
    """

    device: str
    mode: str
    row: int
    poll: int = 0


class Row(NamedTuple):
    """A call with a new request, and the polls after it: calls that repeat earlier requests in turn.

    Attributes:
        calls: number of calls in the row, the first included.
        cycle: number of requests that the polls repeat in turn.
    """

    calls: int
    cycle: int

    def polls(self) -> list[int]:
        """Returns the numbers of the first call and of the calls in the first and last cycle, from 0."""
        ends = (*range(1 + self.cycle), *range(self.calls - self.cycle, self.calls))
        return sorted({poll for poll in ends if 0 <= poll < self.calls})


class Rows:
    """Groups calls into rows: a call that does not continue the current cycle of polls begins a new row.

    Attributes:
        rows: all rows; the last one still grows.
    """

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self._asked: list[bytes] = []
        self._next = -1  # position in the cycle that repeats; negative: no cycle repeats yet

    def add(self, asked: bytes) -> None:
        """Adds a call with the request `asked` to the last row or to a new one."""
        if self._repeats(asked):
            self.rows[-1] = Row(self.rows[-1].calls + 1, len(self._asked))
        else:
            self.rows.append(Row(1, 1))

    def _repeats(self, asked: bytes) -> bool:
        if self._next < 0:
            if asked not in self._asked:
                self._asked.append(asked)
                return False
            del self._asked[: self._asked.index(asked)]
            self._next = 0
        if asked != self._asked[self._next]:
            self._asked, self._next = [asked], -1
            return False
        self._next = (self._next + 1) % len(self._asked)
        return True


class Hindrance:
    """Counts the calls to a device; from the case's call on, the device is in the case's mode."""

    def __init__(self, case: Case | None) -> None:
        self.case = case
        self.began_s: float | None = None
        self._calls = Rows()

    @property
    def rows(self) -> list[Row]:
        """The rows of the calls so far."""
        return self._calls.rows

    def heard(self, data: bytes) -> str:
        """Counts a call with the request `data`; returns the device's mode now, "" before the case's call."""
        # Without the transaction number of Modbus TCP, in which equal requests differ.
        self._calls.add(data[2:] if data[2:4] == b"\0\0" else data)
        at = (len(self.rows) - 1, self.rows[-1].calls - 1)
        if self.case is None or at < (self.case.row, self.case.poll):
            return ""
        if self.began_s is None:
            self.began_s = time.monotonic()
        return self.case.mode

    @property
    def mode(self) -> str:
        """The device's mode now, "" before the call of the case."""
        return "" if self.began_s is None or self.case is None else self.case.mode


class Relay:
    """Transfers bytes between a run and one device, in both directions, until it is closed."""

    def __init__(self, hindrance: Hindrance) -> None:
        self._hindrance = hindrance
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        raise NotImplementedError

    def _stop_flow(self) -> None:
        """Makes the run unable to send; does nothing here."""

    def _relay(self, run: int, device: int) -> None:
        """Transfers bytes between two descriptors until one hangs up."""
        while not self._closed.is_set():
            mode = self._hindrance.mode
            if mode == "gone":
                return
            if mode == "endless":
                self._flood(run)
            listened = [device] if mode == "stopped" else [run, device]
            ready = select.select(listened, [], [], FLOOD_S if mode == "endless" else 0.02)[0]
            if run in ready:
                if not (data := os.read(run, 4096)):
                    return
                mode = self._hindrance.heard(data)
                if mode == "stopped":
                    self._stop_flow()
                if mode in ("", "slow", "drip"):
                    os.write(device, data)
            if device in ready:
                if not (data := os.read(device, 4096)):
                    return
                self._answer(run, data, mode)

    def _flood(self, run: int) -> None:
        """Sends the run as many bytes as it accepts at once."""
        os.set_blocking(run, False)
        with contextlib.suppress(BlockingIOError):
            os.write(run, FLOOD)

    def _answer(self, run: int, data: bytes, mode: str) -> None:
        if mode == "slow":
            self._closed.wait(SLOW_S)
        if mode == "drip":
            for at in range(len(data)):
                self._closed.wait(DRIP_S)
                os.write(run, data[at : at + 1])
        elif mode in ("", "slow"):
            os.write(run, data)


class TcpRelay(Relay):
    """A relay in front of a TCP port."""

    def __init__(self, hindrance: Hindrance, place: tuple[str, int], port: int = 0) -> None:
        super().__init__(hindrance)
        self._place = place
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]

    def close(self) -> None:
        super().close()
        self._listener.close()

    def _run(self) -> None:
        while not self._closed.is_set():
            if not select.select([self._listener], [], [], 0.05)[0]:
                continue
            run = self._listener.accept()[0]
            with contextlib.suppress(OSError), run, socket.create_connection(self._place) as device:
                self._relay(run.fileno(), device.fileno())


class TtyRelay(Relay):
    """A relay in front of a pseudo-terminal."""

    def __init__(self, hindrance: Hindrance, path: str) -> None:
        super().__init__(hindrance)
        self._device = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._device)
        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        self.path = os.ttyname(self._ends[1])

    def close(self) -> None:
        super().close()
        for descriptor in (*self._ends, self._device):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            self._relay(self._ends[0], self._device)
        for descriptor in self._ends:
            os.close(descriptor)

    def _stop_flow(self) -> None:
        termios.tcflow(self._ends[1], termios.TCOOFF)
