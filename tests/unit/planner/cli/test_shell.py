"""What the planner's commands share: the options for cache and cluster, warnings, progress."""

import argparse
import warnings

import pytest

from planner.cli import shell
from planner.kernel import CACHE_VARIABLE
from planner.learned.store import StoreWarning
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


def test_a_pipe_is_told_nothing(capsys):
    with shell.progress(quiet=False) as report:
        report("roll-outs", 1, 3)
    assert capsys.readouterr() == ("", "")
