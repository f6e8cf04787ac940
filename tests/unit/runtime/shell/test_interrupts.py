"""Stop requests raise, wait or are only acknowledged; the tests send signals to their own process."""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from runtime.shell import interrupts
from runtime.shell.interrupts import SIGNALS, StopRequests, stoppable, whole

WAIT_S = 30.0


def ask(number: signal.Signals = signal.SIGINT) -> None:
    os.kill(os.getpid(), number)


def await_request() -> None:
    """Sleep in short steps, so that a request can raise."""
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until:
        time.sleep(0.001)


@pytest.mark.parametrize("number", SIGNALS)
def test_stop_requests_each_signal_raises_once(number, capfd):
    def asked_here():
        with stoppable():
            ask(number)
            await_request()

    with StopRequests():
        with pytest.raises(KeyboardInterrupt):
            asked_here()
        with stoppable():
            ask(number)
    assert capfd.readouterr().err == "stopping already\n"


def test_stoppable_request_dropped_by_python_is_raised_again(monkeypatch):
    """Python prints and drops an exception that a finalizer raises."""
    # Printing may take longer than LOST_S.
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)

    class Finalized:
        def __del__(self):
            ask()
            time.sleep(0.01)

    def work():
        with stoppable():
            Finalized()
            await_request()

    with StopRequests(), pytest.raises(KeyboardInterrupt):
        work()


def test_stoppable_earlier_request_raises_on_entry():
    with StopRequests():
        ask()
        with pytest.raises(KeyboardInterrupt):
            stoppable().__enter__()


def test_stoppable_request_raised_on_entry_is_not_raised_again():
    """The records and messages that follow the request must not be interrupted."""
    with StopRequests(), whole():
        ask()
        with contextlib.suppress(KeyboardInterrupt), stoppable():
            pass
        time.sleep(3 * interrupts.LOST_S)


def test_whole_block_ends_before_request_raises():
    reached = []

    def work():
        with stoppable():
            with whole():
                ask()
                reached.append("whole")
            reached.append("never")

    with StopRequests(), pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["whole"]


def test_stoppable_earlier_fault_is_not_replaced_by_request():
    """The request raises neither while the fault propagates, nor in its handler, nor after `conclude`."""
    reached = []

    def work():
        with stoppable():
            try:
                Path("/nowhere").stat()
            finally:
                ask()
                reached.append("on its way")

    with StopRequests():
        try:
            work()
        except FileNotFoundError:
            reached.append("safe sequence")
            interrupts.conclude()
        with stoppable():
            ask()
    assert reached == ["on its way", "safe sequence"]


def test_stop_requests_unread_acknowledgement_does_not_block(monkeypatch):
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    monkeypatch.setattr(interrupts, "STDERR", writing)
    with StopRequests():
        ask()
        ask()
        os.close(reading)
        ask()
        os.close(writing)
        ask()


def test_stop_requests_ignored_hangup_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopRequests(), stoppable():
            ask(signal.SIGHUP)
            time.sleep(0.01)
    finally:
        signal.signal(signal.SIGHUP, before)
