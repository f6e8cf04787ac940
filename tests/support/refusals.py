"""What is refused at an edge, and allowed on the other side of it."""

from contextlib import contextmanager, nullcontext

import pytest


def refusal(error, match, *, unless):
    """A context in which an error is raised, or none where the edge is kept."""
    return nullcontext() if unless else pytest.raises(error, match=match)


@contextmanager
def refused_in_a_line(error, match=None):
    """A context in which an error is raised whose message is a line."""
    with pytest.raises(error, match=match) as raised:
        yield raised
    assert "\n" not in str(raised.value)
