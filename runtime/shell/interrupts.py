"""Stop requests: Ctrl-C, SIGTERM, SIGHUP (a lost session) and SIGQUIT all request a command to stop.

A stop request raises KeyboardInterrupt once, only in `stoppable` code, and never while an exception is being
handled. Elsewhere the request waits for the next `stoppable` code. So the command ends with the fault or the
request, whichever comes first, and nothing interrupts what follows: safe sequence, records, last messages.
Decision 0018 says why. A deadline (`within`) raises its error under the same conditions.
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
# time until a request is raised again after it came while an exception was being handled
AGAIN_S = 0.01
# time until a request is raised again that Python dropped (in a finalizer or a callback)
LOST_S = 0.1


class _Request:
    """State of the stop request. The process has one such object, since signals are sent to processes."""

    listening = False  # whether signals request a stop
    asked = False  # whether a signal has come
    open = False  # whether the request may raise now: the code that runs is stoppable
    over = False  # whether the request was raised, or comes too late to have an effect
    # builds the error of a deadline that has passed; None: no deadline has passed
    late: Callable[[], Exception] | None = None

    def deliver(self) -> None:
        """Raises a pending stop request, or the error of a passed deadline, if the code is stoppable.

        While an exception is being handled, only sets a timer to try again.
        """
        stop = self.asked and not self.over
        if not self.open or not (stop or self.late):
            return
        if sys.exception() is not None:
            # The exception may be no fault: a driver may handle it by a retry. Then the request is raised.
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
            return
        # If Python drops the error, the timer raises it again. Otherwise the error has left the stoppable
        # code when the timer fires, and nothing happens.
        signal.setitimer(signal.ITIMER_REAL, LOST_S)
        raise KeyboardInterrupt if stop or self.late is None else self.late()


_request = _Request()


@contextlib.contextmanager
def _region(*, opened: bool) -> Iterator[None]:
    """Context in which stop requests raise (`opened`), or in which they do not; contexts may be nested."""
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
    """Context in which a stop request raises KeyboardInterrupt; a request that came before raises at once."""
    return _region(opened=True)


def whole() -> "contextlib._GeneratorContextManager[None]":
    """Context in which a stop request raises nothing, except within an inner `stoppable` context."""
    return _region(opened=False)


@contextlib.contextmanager
def within(seconds: float, late: Callable[[], Exception]) -> Iterator[None]:
    """Context with a deadline, which raises an error where and when a stop request would raise.

    Outside of a `StopRequests` context there is no deadline: no signal handler is installed that could raise
    the error.

    Args:
        seconds: the deadline, s of wall time.
        late: builds the error.
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
        timer.join()  # from now on the timer sends no signal
        _request.late = None


def conclude() -> None:
    """Notes that the command's work is done: from now on a stop request raises nothing."""
    _request.over = True


class StopRequests:
    """Context in which the signals in `SIGNALS` are stop requests.

    SIGHUP stays ignored if it was ignored before (nohup).

    Args:
        last: whether the process ends after the context. Then it ignores the signals from the end of the
            context on, so that no signal changes its exit code.
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
    """Answers a repeated stop request: prints "stopping already" on standard error if that does not block."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [STDERR], [], 0.0)[1]:
            os.write(STDERR, b"stopping already\n")
