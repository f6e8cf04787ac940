"""Waiting for what another thread or process brings about."""

import time
from collections.abc import Callable
from typing import TypeVar

WAIT_S = 120.0  # generous: the machine may have other work

T = TypeVar("T")


def until(holds: Callable[[], T], what: object = "", pause_s: float = 0.01) -> T:
    """The first true value of a condition; fails with `what` if there is none within `WAIT_S`."""
    end = time.monotonic() + WAIT_S
    while not (result := holds()):
        assert time.monotonic() < end, f"not within {WAIT_S:g} s: {what}"
        time.sleep(pause_s)
    return result
