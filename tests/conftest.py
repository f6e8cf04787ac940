"""For every test: signals, environment and settings of the process, and common fixtures."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from sample_tables import small_table

from runtime.shell.interrupts import SIGNALS
from runtime.table import dump

# A shell without job control ignores Ctrl-C and SIGQUIT in what it starts with `&`, and nohup ignores SIGHUP;
# processes hand that down. The tests send them to themselves and to the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
for ignored in (signal.SIGHUP, signal.SIGQUIT):
    signal.signal(ignored, signal.SIG_DFL)

# A deadline of an example would depend on the clock of a busy machine.
settings.register_profile("tests", deadline=None)
settings.load_profile("tests")

# The tests have other work for every core; threads of linear algebra would wait for one another, spinning.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A forked process does not have OpenCV's threads, and would wait for them for ever.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
# Users start commands without it. With it, no output is buffered, so that none could be lost at the end.
os.environ.pop("PYTHONUNBUFFERED", None)


USUAL = {number: signal.getsignal(number) for number in (*SIGNALS, signal.SIGALRM)}


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    """Restores the signal handlers before and after each test.

    Commands that end their process leave signals ignored, also if a fixture runs them.
    """
    _handle_as_usual()
    yield
    _handle_as_usual()


def _handle_as_usual() -> None:
    for number, handler in USUAL.items():
        signal.signal(number, handler)


@pytest.fixture
def plate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only file of the current folder: a drawing without a unit."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "plate.csv"
    path.write_text("0,0\n30,0\n30,21\n0,21\n")
    return path


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The small table's file, alone in its folder."""
    dump(small_table(), tmp_path / "small.msgpack")
    return tmp_path / "small.msgpack"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of these tests."""
    message = "crash at every moment of a run, not at a sample of them"
    parser.addoption("--every-moment", action="store_true", help=message)
