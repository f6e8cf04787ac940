"""What the planner's commands share: the options for cache and cluster, warnings, progress."""

import argparse
import signal
import warnings

import pytest

from planner.cli import shell
from planner.kernel import CACHE_VARIABLE
from planner.learned.store import StoreWarning
from planner.work.limit import Limit
from runtime.shell.files import OutputError


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


def test_a_stated_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be made"):
        shell.store_of(options("--cache-dir", str(tmp_path / "file" / "x")))


def test_no_cache_and_a_folder_for_it_contradict_each_other(tmp_path, capsys):
    with pytest.raises(SystemExit):
        options("--no-cache", "--cache-dir", str(tmp_path))
    assert "not allowed with" in capsys.readouterr().err


def test_trouble_with_the_store_is_one_line_and_no_failure(capsys):
    def body(_):
        warnings.warn("folder: cannot be written", StoreWarning, stacklevel=1)
        return 0

    assert run(body) == 0
    assert capsys.readouterr().err == "plan-x: warning: folder: cannot be written\n"


def test_other_warnings_stay_what_they_are():
    with pytest.warns(DeprecationWarning, match="old"):
        run(lambda _: warnings.warn("old", DeprecationWarning, stacklevel=1) or 0)


def test_a_terminal_is_told_the_stage_and_the_time_that_is_left(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    with shell.progress(quiet=False) as report:
        for done in range(4):
            report("roll-outs", done, 3)
        report("search", 0, 9)
    err = capsys.readouterr().err
    assert "left:" in err
    assert "search" in err


class Clock:
    """Stands until it is told to go on."""

    now = 0.0

    def __call__(self):
        return self.now


def test_a_pipe_gets_a_line_every_few_seconds_with_the_time_that_is_left(capsys):
    clock = Clock()
    with shell.progress(False, clock) as report:
        for done in range(13):
            clock.now = float(done)
            report("search", done, 100, "12.0% of the parts open")
    assert capsys.readouterr().err.splitlines() == [
        "search 5%, left: about 95 s, 12.0% of the parts open",
        "search 10%, left: about 90 s, 12.0% of the parts open",
    ]


def test_an_estimate_is_of_the_stage_alone_and_none_is_made_before_something_is_done(capsys):
    clock = Clock()
    with shell.progress(False, clock) as report:
        report("roll-outs", 3, 3)
        clock.now = 6.0
        report("search", 0, 9)
        clock.now = 12.0
        report("search", 3, 9)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "search 0%, left: not known yet"
    assert second == "search 33%, left: about 12 s"


def test_what_was_done_before_a_stage_is_heard_of_again_says_nothing_of_its_rate(capsys):
    clock = Clock()
    with shell.progress(False, clock) as report:
        for now, done in ((6.0, 50), (12.0, 75), (18.0, 20), (24.0, 60)):
            clock.now = now
            report("evaluate", done, 100)
    assert capsys.readouterr().err.splitlines() == [
        "evaluate 50%, left: not known yet", "evaluate 75%, left: about 6 s",
        "evaluate 20%, left: not known yet", "evaluate 60%, left: about 6 s",
    ]  # fmt: skip


def test_a_terminal_shows_the_same_estimate(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    clock = Clock()
    with shell.progress(False, clock) as report:
        report("search", 0, 4)
        clock.now = 10.0
        report("search", 1, 4, "9.0% of the parts open")
    err = capsys.readouterr().err
    assert "left: about 30 s" in err
    assert "-:--:--" not in err


def test_nobody_is_told_where_it_is_to_be_quiet_or_what_takes_little_time(capsys):
    clock = Clock()
    with shell.progress(True, clock) as report:
        clock.now = 99.0
        report("search", 1, 3)
    with shell.progress(False) as report:
        report("search", 1, 3)
    assert capsys.readouterr() == ("", "")


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


def test_an_interrupt_before_anything_stands_is_one():
    with shell.stopping(Limit(), "plan-x"), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
