"""What the planner's commands share: the options for cache and cluster, warnings, progress."""

import argparse
import signal
import warnings

import pytest

from planner.cli import shell
from planner.kernel import CACHE_VARIABLE
from planner.learned.store import StoreWarning
from planner.work.limit import Limit


def options(*words):
    parser = argparse.ArgumentParser()
    shell.add_cache(parser)
    shell.add_scheduler(parser)
    return parser.parse_args(words)


def run(body):
    return shell.run(shell.parser("plan-x", "Does it."), [], body)


def test_roll_outs_are_kept_where_the_options_say(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "users"))
    assert shell.store_of(options()).folder == tmp_path / "users" / "rollouts"
    stated = tmp_path / "a" / "b"
    assert shell.store_of(options("--cache-dir", str(stated))).folder == stated / "rollouts"
    assert shell.store_of(options("--no-cache")) is None


def test_trouble_with_the_store_is_one_line_and_no_failure(capsys):
    def body(_):
        warnings.warn("folder: cannot be written", StoreWarning, stacklevel=1)
        return 0

    assert run(body) == 0
    assert capsys.readouterr().err == "plan-x: warning: folder: cannot be written\n"


def test_the_first_interrupt_asks_and_the_next_one_interrupts(capfd):
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
def test_failure_of_what_an_answer_can_do_without_is_a_note(error, capsys):
    notes = []
    with shell.spared("picture", notes):
        raise error
    with shell.spared("advice", notes):
        pass
    assert len(notes) == 1
    assert "no picture" in notes[0]
    assert capsys.readouterr().err == ""
