"""What is refused at an edge, and allowed on the other side of it."""

from contextlib import nullcontext

import pytest


def refusal(error, match, *, unless):
    """A context in which an error is raised, or none where the edge is kept."""
    return nullcontext() if unless else pytest.raises(error, match=match)
