"""Counters of parts since the start, and their times, in the units of the registers."""

from collections import Counter

from runtime.plc.registers import OUTCOMES, UNKNOWN
from runtime.table import takt_figures


class Counters:
    """Parts by their outcome, the seconds of the last one, and the share done within a takt.

    Args:
        takt_s: time within which parts should be done; None: no takt.
    """

    def __init__(self, takt_s: float | None = None) -> None:
        self._takt_s = takt_s
        self._seconds: Counter[float] = Counter()  # in hundredths: limited in number
        self._values = {f"parts_{name}": 0 for name in OUTCOMES[1:]}
        self._values |= {"seconds_last": UNKNOWN, "takt_share": UNKNOWN}

    def add(self, outcome: int, seconds: float) -> None:
        """Adds one part by its `Answer.outcome` and its seconds; NaN: unknown."""
        self._values[f"parts_{OUTCOMES[outcome]}"] += 1
        self._values["seconds_last"] = UNKNOWN
        if not seconds > 0.0:  # a clock that does not advance times nothing
            return
        self._values["seconds_last"] = min(round(100.0 * seconds), UNKNOWN)
        self._seconds[round(seconds, 2)] += 1
        if self._takt_s is not None:
            share = takt_figures(self._seconds, self._takt_s)["takt_probability"]
            self._values["takt_share"] = round(1e4 * share)

    def values(self) -> dict[str, int]:
        """Values by register name."""
        return self._values
