"""Figures of a shift: good parts, seconds a part compared with the takt, and the most frequent losses."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from runtime.devices.clock import SystemClock
from runtime.traversal.results import Outcome, PartResult

CHANGES = (6, 14, 22)  # hours of the day, local time
SHOWN_LOSSES = 6


class Loss(NamedTuple):
    """A group of parts that were lost in the same way after the same number of squeezes."""

    kind: str  # how the parts were lost: an outcome, "audit" or "delivery"
    squeeze: int  # number of squeezes before the loss
    node: int | None  # node of the latest part's last squeeze; None without a squeeze
    width_mm: float | None  # width that was read at this squeeze; None if unknown
    reason: str  # reason for the latest part's loss; "" if unknown
    part: int  # number of the latest part of the group
    parts: int  # number of parts in the group


class Shift:
    """Counts the parts of the present shift: all parts with their seconds, good parts, and lost parts.

    The counts begin at the latest change of shift, or at the start of the run if that is later.

    Args:
        changes: hours of the day at which shifts change, local time.
        takt_s: time within which a part should be done, s; None: no takt.
        clock: tells the time of day; None: the system's clock.
    """

    def __init__(
        self, changes: Sequence[int], takt_s: float | None, clock: SystemClock | None = None
    ) -> None:
        self._changes, self._takt_s, self._clock = changes, takt_s, clock or SystemClock()
        self._begin(self._clock.shift(changes), self._clock.local())

    def _begin(self, change: str, since: str) -> None:
        self._change, self._since = change, since
        self._parts, self._good, self._timed, self._in_takt, self._seconds = 0, 0, 0, 0, 0.0
        self._losses: dict[tuple[str, int], Loss] = {}

    def _renew(self) -> None:
        change = self._clock.shift(self._changes)
        if change != self._change:
            self._begin(change, change)

    def add(self, result: PartResult) -> None:
        """Counts a part that has ended."""
        self._renew()
        last = result.steps[-1] if result.steps else None
        self._count(result.fields(), None if last is None else last.width_um / 1000)

    def recall(self, journal: Path, table_sha256: str) -> None:
        """Adds the parts of earlier runs of the same table in this shift, as the journal records them.

        Reads only the current file of the journal, not the sealed segments.

        Args:
            journal: path of the journal.
            table_sha256: digest of the table's file.
        """
        # Stops at the first line that is no record. The journal is verified later, when the run opens it.
        with suppress(OSError, ValueError, KeyError, TypeError):
            for record in _outcomes(journal, table_sha256):
                ended = self._clock.local_of(str(record["time"]))
                if ended >= self._change:
                    self._count(record, None)
                    self._since = min(self._since, ended)

    def _count(self, part: Mapping[str, Any], width_mm: float | None) -> None:
        """Counts a part that has ended.

        Args:
            part: fields of the part's outcome, as in the journal.
            width_mm: width that was read at the part's last squeeze; None if unknown.
        """
        seconds, kind, path = part["seconds"], _kind(part), part["path"]
        self._parts += 1
        if seconds:
            self._timed += 1
            self._seconds += seconds
            self._in_takt += self._takt_s is not None and seconds <= self._takt_s
        if kind is None:
            self._good += 1
            return
        key, node = (kind, len(path)), path[-1] if path else None
        before = self._losses[key].parts if key in self._losses else 0
        reason = part["reason"] or ""
        self._losses[key] = Loss(*key, node, width_mm, reason, part["part"], before + 1)

    def as_object(self) -> dict[str, object]:
        """The counts in the form of JSON; `losses` lists the largest groups of lost parts, largest first."""
        self._renew()
        losses = sorted(self._losses.values(), key=lambda loss: -loss.parts)[:SHOWN_LOSSES]
        timed = self._timed
        return {
            "since": self._since,
            "parts": self._parts,
            "good": self._good,
            "seconds_mean": round(self._seconds / timed, 3) if timed else None,
            "takt_s": self._takt_s,
            "takt_share": self._in_takt / timed if timed and self._takt_s is not None else None,
            "losses": [loss._asdict() for loss in losses],
        }


def _kind(part: Mapping[str, Any]) -> str | None:
    """Returns how a part was lost (an outcome, "audit" or "delivery"); None if the part was not lost."""
    if part["outcome"] != Outcome.LEAF.value:
        return str(part["outcome"])
    if part["audit"] == "fail":
        return "audit"
    return "delivery" if part["delivery"] == "missed" else None


def _outcomes(journal: Path, table_sha256: str) -> Iterator[Mapping[str, Any]]:
    """Yields the records of kind `outcome` in a journal, from the runs with a given table.

    Args:
        journal: path of the journal.
        table_sha256: digest of the table's file.
    """
    same = False
    with journal.open("rb") as file:
        for line in file:
            record = json.loads(line)
            if record["kind"] == "header":
                same = record["table_sha256"] == table_sha256
            elif record["kind"] == "outcome" and same:
                yield record
