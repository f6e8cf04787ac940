"""Contexts for tests of limits: a value is refused on one side of a limit, and allowed on the other."""

from contextlib import contextmanager, nullcontext

import pytest


def refusal(error, match, *, unless):
    """A context that expects an error, or no error if `unless` is true."""
    return nullcontext() if unless else pytest.raises(error, match=match)


@contextmanager
def refused_in_a_line(error, match=None):
    """A context that expects an error whose message is a single line."""
    with pytest.raises(error, match=match) as raised:
        yield raised
    assert "\n" not in str(raised.value)
