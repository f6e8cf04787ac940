"""What every test needs of its process."""

import os
import signal

import pytest

# A shell without job control ignores Ctrl-C in what it starts with `&`, and nohup ignores SIGHUP; processes
# hand that down. The tests send both to themselves and to the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# The tests have other work for every core; threads of linear algebra would wait for one another, spinning.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Commands are tested as users start them: with it, nothing is ever left over that could be lost at the end.
os.environ.pop("PYTHONUNBUFFERED", None)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of these tests."""
    told = "crash at every moment of a run, not at a sample of them"
    parser.addoption("--every-moment", action="store_true", help=told)
