"""Ctrl-C, SIGTERM, SIGHUP (a session that dropped) and SIGQUIT are one request: to stop. It is raised once.

A request raises KeyboardInterrupt only in what is `stoppable`, and never while an exception is being handled:
what came first, a fault or the request, is what the command ends with, and nothing cuts short what follows
from it: safe sequence, records, last words. At any other time it waits for the next `stoppable`. Decision
0018 says why. A deadline (`within`) is delivered in the same way, by an error of its own.
"""

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Self

STDERR = 2
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
AGAIN_S = 0.01  # until a request that met the handling of an exception is tried again
LOST_S = 0.1  # until one that was raised where Python drops exceptions (finalizer, callback) is raised again


class _Request:
    """State of the stop request; one a process, as signals are."""

    listening = False  # whether signals are requests
    asked = False  # whether a signal came
    open = False  # whether it may raise now
    over = False  # whether it was heard, or can change nothing any more
    # what a deadline that has passed raises; None: none has
    late: Callable[[], Exception] | None = None

    def deliver(self) -> None:
        """Raise it if it may, or the error of a deadline that has passed."""
        stop = self.asked and not self.over
        if not self.open or not (stop or self.late):
            return
        if sys.exception() is not None:
            # A driver may be about to try again, and the exception no fault at all.
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
            return
        # Heard, it leaves what is stoppable.
        signal.setitimer(signal.ITIMER_REAL, LOST_S)
        raise KeyboardInterrupt if stop or self.late is None else self.late()


_request = _Request()


@contextlib.contextmanager
def _region(*, opened: bool) -> Iterator[None]:
    before, _request.open = _request.open, opened
    try:
        _request.deliver()
        yield
    except KeyboardInterrupt:
        _request.over = True  # heard
        raise
    finally:
        _request.open = before
        _request.deliver()


def stoppable() -> "contextlib._GeneratorContextManager[None]":
    """A stop request raises KeyboardInterrupt in here, one that came before at once."""
    return _region(opened=True)


def whole() -> "contextlib._GeneratorContextManager[None]":
    """No stop request raises in here, but in what is stoppable within."""
    return _region(opened=False)


@contextlib.contextmanager
def within(seconds: float, late: Callable[[], Exception]) -> Iterator[None]:
    """After so many wall seconds in here `late()` is raised, where and when a stop request would be.

    Nothing is raised where no `StopRequests` are entered: there are no signals then that end a call.
    """
    if not _request.listening:
        yield
        return

    def passed() -> None:
        _request.late = late
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGALRM)

    timer = threading.Timer(seconds, passed)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()  # from now on it sends no signal
        _request.late = None


def conclude() -> None:
    """The command's outcome is decided: a stop request raises nothing any more."""
    _request.over = True


class StopRequests:
    """While entered, `SIGNALS` are stop requests; those that were to be ignored by SIGHUP (nohup) still are.

    With `last` the process ends when this is left; the signals are then ignored for the rest of it, so that
    none changes its exit code.
    """

    def __init__(self, *, last: bool = False) -> None:
        self._last = last
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        _request.asked = _request.open = _request.over = False
        _request.listening = True
        for number in SIGNALS:
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._hear)
        self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, lambda *_: _request.deliver())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        conclude()
        _request.listening = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._last else handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if _request.asked or _request.over:
            _acknowledge()
        _request.asked = True
        _request.deliver()


def _acknowledge() -> None:
    """Say that it was heard before, unless nobody reads it: nothing may wait for that."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [STDERR], [], 0.0)[1]:
            os.write(STDERR, b"stopping already\n")
