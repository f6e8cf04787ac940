"""When work ends before it is done: its budget of time is spent, or somebody asks for what there is."""

import math
import time
from collections.abc import Callable


class Limit:
    """A budget of time, and a request to end with what stands; work looks at both between its steps."""

    def __init__(
        self, budget_s: float = math.inf, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begins to count; the clock tells seconds."""
        self.budget_s = budget_s
        self.reserve_s = 0.0  # of the budget, what is kept for the work that follows
        self.asked = False  # whether to end at once
        self.standing = False  # whether there is something that could be kept
        self._clock = clock
        self._start = clock()

    @property
    def spent_s(self) -> float:
        """Seconds since the start."""
        return self._clock() - self._start

    @property
    def left_s(self) -> float:
        """Seconds before the reserve; infinite without a budget."""
        return self.budget_s - self.reserve_s - self.spent_s

    @property
    def bounded(self) -> bool:
        """Whether there is a budget."""
        return math.isfinite(self.budget_s)

    def start(self) -> None:
        """Counts from now on: what came before is not on the budget."""
        self._start = self._clock()

    def ask(self) -> bool:
        """Asks to end with what stands; False where nothing does, or where that was asked before."""
        heard = self.standing and not self.asked
        self.asked = self.asked or heard
        return heard

    def over(self, kept_s: float = 0.0) -> bool:
        """Whether to end now, with the reserve and so many seconds more left."""
        return self.asked or self.left_s < kept_s
