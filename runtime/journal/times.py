"""Statistics of how long the parts of a journal took: mean of each phase, and distribution of the total."""

from collections import Counter
from collections.abc import Iterable, Iterator
from math import fsum
from typing import NamedTuple

from runtime.journal.lines import Entry
from runtime.table import Phases, phases_of, takt_figures, takt_text, time_of


class Times(NamedTuple):
    """Statistics of how long the parts of a journal took."""

    parts: int  # number of parts with an outcome and seconds
    squeezes: int
    phases: dict[str, float]  # mean seconds a part, by the name of the phase
    figures: dict[str, float]  # from `runtime.table.takt`; empty without a part

    def fields(self) -> dict[str, object]:
        """The statistics as fields of a JSON object."""
        return {
            "parts": self.parts,
            "squeezes": self.squeezes,
            "phases": self.phases,
            **self.figures,
        }

    def lines(self) -> Iterator[str]:
        """Yields the statistics as lines of text."""
        if not self.parts:
            yield "no part states its seconds"
            return
        mean_s = self.figures["seconds_mean"]
        yield f"{self.parts} parts, {self.squeezes} squeezes; seconds a part:"
        for name, value in self.phases.items():
            if value:
                yield f"  {name:9}{value:7.2f}  {value / mean_s:4.0%}"
        for name, value in self.figures.items():
            if name.startswith("seconds_"):
                yield f"  {name.removeprefix('seconds_'):9}{value:7.2f}"
        if "takt_s" in self.figures:
            yield f"  {takt_text(self.figures)}"


def times_of(entries: Iterable[Entry], takt_s: float | None = None) -> Times:
    """Computes the statistics from a journal's records of outcomes; those without seconds are skipped.

    `takt_s` is the time within which a part should be done, if there is one.

    Raises:
        ValueError: a record's seconds are invalid.
    """
    seconds: Counter[float] = Counter()
    spent: list[Phases] = []
    for entry in entries:
        if entry["kind"] == "outcome" and entry.get("seconds") is not None:
            seconds[time_of(entry["seconds"])] += 1
            listed = entry.get("phases")
            if not isinstance(listed, list):
                raise ValueError("phases are no list")
            spent += map(phases_of, listed)
    parts = seconds.total()
    sums = [fsum(column) for column in zip(*spent, strict=True)] or [0.0] * len(Phases._fields)
    names = (name.removesuffix("_s") for name in Phases._fields)
    means = {name: value / max(parts, 1) for name, value in zip(names, sums, strict=True)}
    if parts:
        whole_s = fsum(taken * many for taken, many in seconds.items())
        means["other"] = max(whole_s - fsum(sums), 0.0) / parts
    return Times(parts, len(spent), means, takt_figures(seconds, takt_s) if parts else {})
