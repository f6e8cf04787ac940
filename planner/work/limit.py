"""Limits of work: a budget of time, or a request to end with the result so far."""

import math
import time
from collections.abc import Callable


class Limit:
    """Says when work should end: its budget of time is spent, or an early end was requested."""

    def __init__(
        self, budget_s: float = math.inf, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Starts a budget of seconds, unlimited by default; `clock` returns the time in seconds."""
        self.budget_s = budget_s
        self.reserve_s = 0.0  # part of the budget that is kept for the work that follows
        self.asked = False  # whether to end at once
        self.standing = False  # whether there is a result to keep
        self._clock = clock
        self._start = clock()

    @property
    def spent_s(self) -> float:
        """Seconds since the budget was started."""
        return self._clock() - self._start

    @property
    def left_s(self) -> float:
        """Seconds left of the budget, less the part reserved for later work; infinite without a budget."""
        return self.budget_s - self.reserve_s - self.spent_s

    @property
    def bounded(self) -> bool:
        """Whether there is a budget."""
        return math.isfinite(self.budget_s)

    def start(self) -> None:
        """Starts the budget anew, so that earlier work does not count."""
        self._start = self._clock()

    def ask(self) -> bool:
        """Requests an early end.

        Returns:
            Whether the request is accepted: there is a result to keep, and no request was accepted before.
        """
        heard = self.standing and not self.asked
        self.asked = self.asked or heard
        return heard

    def over(self, kept_s: float = 0.0) -> bool:
        """Whether to end now: an end was requested, or `left_s` is less than `kept_s`."""
        return self.asked or self.left_s < kept_s
