"""What every test needs of its process."""

import signal

import pytest

# A shell without job control ignores Ctrl-C in what it starts with `&`, and nohup ignores SIGHUP; processes
# hand that down. The tests send both to themselves and to the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of these tests."""
    told = "crash at every moment of a run, not at a sample of them"
    parser.addoption("--every-moment", action="store_true", help=told)
