"""When a stop request raises, when it waits, when it is only acknowledged; by signals to ourselves."""

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
    """Wait where a request may raise."""
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until:
        time.sleep(0.001)


@pytest.mark.parametrize("number", SIGNALS)
def test_each_signal_is_a_request_that_is_raised_once(number, capfd):
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


def test_a_request_that_python_drops_is_raised_again(monkeypatch):
    """In a finalizer an exception is printed and forgotten."""
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


def test_a_request_waits_until_it_may_raise():
    with StopRequests():
        ask()
        with pytest.raises(KeyboardInterrupt):
            stoppable().__enter__()


def test_a_request_heard_on_entering_raises_nothing_afterwards():
    """What follows from it, records and last words, is whole."""
    with StopRequests(), whole():
        ask()
        with contextlib.suppress(KeyboardInterrupt), stoppable():
            pass
        time.sleep(3 * interrupts.LOST_S)


def test_what_is_whole_is_left_before_a_request_raises():
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


def test_a_fault_that_came_first_is_not_replaced():
    """Neither on its way, nor in its handler, nor when that is over and the command has concluded."""
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


def test_nothing_waits_for_a_reader_of_the_acknowledgement(monkeypatch):
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


def test_a_hangup_that_was_to_be_ignored_is():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with StopRequests(), stoppable():
        ask(signal.SIGHUP)
        time.sleep(0.01)
