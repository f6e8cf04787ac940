"""Relays that count the calls of a run to its devices, and at one of them change what comes back."""

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


class Case(NamedTuple):
    """Which device changes how, at which of the run's calls to it."""

    device: str
    mode: str
    call: int


class Hindrance:
    """Counts calls; from the case's call on its mode holds."""

    def __init__(self, case: Case | None) -> None:
        self.case, self.calls = case, 0
        self.began_s: float | None = None

    def heard(self) -> str:
        """One more call; the mode that holds now, empty for none."""
        self.calls += 1
        if self.case is None or self.calls <= self.case.call:
            return ""
        if self.began_s is None:
            self.began_s = time.monotonic()
        return self.case.mode

    @property
    def mode(self) -> str:
        """The mode that holds."""
        return "" if self.began_s is None or self.case is None else self.case.mode


class Relay:
    """Bytes between a run and one device, both ways, until it is closed."""

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
        """Take nothing any more."""

    def _relay(self, run: int, device: int) -> None:
        """Relay between two descriptors until one hangs up."""
        while not self._closed.is_set():
            mode = self._hindrance.mode
            if mode == "gone":
                return
            if mode == "endless":
                with contextlib.suppress(BlockingIOError):
                    if select.select([], [run], [], 0.01)[1]:
                        os.write(run, os.urandom(200))
            listened = [device] if mode == "stopped" else [run, device]
            ready = select.select(listened, [], [], 0.0 if mode == "endless" else 0.02)[0]
            if run in ready:
                if not (data := os.read(run, 4096)):
                    return
                mode = self._hindrance.heard()
                if mode == "stopped":
                    self._stop_flow()
                if mode in ("", "slow", "drip"):
                    os.write(device, data)
            if device in ready:
                if not (data := os.read(device, 4096)):
                    return
                self._answer(run, data, mode)

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
    """In front of a TCP port."""

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
    """In front of a pseudo-terminal."""

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
