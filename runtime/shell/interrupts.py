"""Stop requests: Ctrl-C, SIGTERM, SIGHUP (a lost session) and SIGQUIT all mean "stop", which is raised once.

A request raises KeyboardInterrupt only in `stoppable` code, and never while an exception is being handled:
the command ends with what came first, a fault or the request, and nothing interrupts what follows from it
(safe sequence, records, last messages). At any other time it waits for the next `stoppable`. Decision 0018
says why. A deadline (`within`) is delivered in the same way, with another error.
"""

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Self

STDERR = 2
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
AGAIN_S = 0.01  # time until a request that came while an exception was being handled is tried again
LOST_S = 0.1  # time until a request that Python dropped (finalizer, callback) is raised again


class _Request:
    """State of the stop request; there is one for the process, since signals are sent to processes."""

    listening = False  # whether signals are requests
    asked = False  # whether a signal came
    open = False  # whether it may raise now
    over = False  # whether it was raised, or comes too late to have an effect
    # error of a deadline that has passed; None: no deadline has passed
    late: Callable[[], Exception] | None = None

    def deliver(self) -> None:
        """Raises a pending stop request, or the error of a deadline that has passed, in stoppable code.

        While an exception is being handled, this only sets a timer to try again.
        """
        stop = self.asked and not self.over
        if not self.open or not (stop or self.late):
            return
        if sys.exception() is not None:
            # A driver may be about to retry, so that the exception is no fault at all.
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
            return
        # Raises the error again if Python drops it; otherwise it has left the stoppable code by then.
        signal.setitimer(signal.ITIMER_REAL, LOST_S)
        raise KeyboardInterrupt if stop or self.late is None else self.late()


_request = _Request()


@contextlib.contextmanager
def _region(*, opened: bool) -> Iterator[None]:
    """Context that lets stop requests raise (`opened`) or prevents it; at its end the former state holds."""
    before, _request.open = _request.open, opened
    try:
        _request.deliver()
        yield
    except KeyboardInterrupt:
        _request.over = True  # raised
        raise
    finally:
        _request.open = before
        _request.deliver()


def stoppable() -> "contextlib._GeneratorContextManager[None]":
    """Context in which a stop request raises KeyboardInterrupt, an earlier one at once."""
    return _region(opened=True)


def whole() -> "contextlib._GeneratorContextManager[None]":
    """Context in which a stop request does not raise, except within an inner `stoppable` context."""
    return _region(opened=False)


@contextlib.contextmanager
def within(seconds: float, late: Callable[[], Exception]) -> Iterator[None]:
    """Context in which, after `seconds` of wall time, `late()` is raised like a stop request.

    Outside of `StopRequests` there is no deadline, since no signal handler could end a call.
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
    """Marks the command's outcome as decided: from now on a stop request raises nothing."""
    _request.over = True


class StopRequests:
    """Context in which `SIGNALS` are stop requests; a SIGHUP ignored before (nohup) stays ignored.

    With `last` the process ends after the context, and ignores the signals from then on, so that none
    changes its exit code.
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

    def __exit__(self, *_: object) -> None:
        conclude()
        _request.listening = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._last else handler)

    def _hear(self, _number: int, _frame: FrameType | None) -> None:
        if _request.asked or _request.over:
            _acknowledge()
        _request.asked = True
        _request.deliver()


def _acknowledge() -> None:
    """Prints on standard error that the command is stopping already; never waits for a reader."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [STDERR], [], 0.0)[1]:
            os.write(STDERR, b"stopping already\n")
