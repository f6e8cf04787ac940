"""What the planner's commands share: interrupts, and optional work whose failure is a note."""

import signal

import pytest

from planner.cli import shell
from planner.work.limit import Limit


def test_stopping_first_interrupt_asks_and_second_raises(capfd):
    limit = Limit()
    limit.standing = True
    usual = signal.getsignal(signal.SIGINT)
    with shell.stopping(limit, "plan-x"):
        signal.raise_signal(signal.SIGINT)
        assert limit.asked
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert capfd.readouterr().err == f"plan-x: {shell.STOPPING}\n"
    assert signal.getsignal(signal.SIGINT) is usual


@pytest.mark.parametrize(
    "error", [ValueError("no path of 3 squeezes"), KeyboardInterrupt(), OSError(28, "full")]
)
def test_spared_exception_becomes_a_note(error, capsys):
    notes = []
    with shell.spared("picture", notes):
        raise error
    with shell.spared("advice", notes):
        pass
    assert len(notes) == 1
    assert "no picture" in notes[0]
    assert capsys.readouterr().err == ""
