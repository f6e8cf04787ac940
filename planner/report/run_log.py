"""The journal of a run, read for pictures: the width of each squeeze, and each part's outcome.

A journal consists of JSON lines. Each line repeats the SHA-256 of the line before, and has a SHA-256 of its
own content. A long journal consists of several files, called segments; this chain of digests is checked
through all of them. `grasp-journal replay` checks that every decision follows from its widths.
"""

import base64
import hashlib
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from runtime.shell import strict_json
from runtime.shell.errors import InputError
from runtime.shell.sealed_lines import GENESIS, is_intact, sealed_segments
from runtime.table import Phases, TableError, TableFile, loads, phases_of, takt_figures, time_of


class Squeezed(NamedTuple):
    """One squeeze of a part."""

    node: int
    width_um: int  # width at which the fingers came to rest
    target: int | None  # where the reading leads: a node, or ~leaf; None if it was rejected


@dataclass(slots=True)
class PartLog:
    """What a journal says of one part; `outcome` is "cut short" if the journal ends before the part does."""

    part: int
    squeezes: list[Squeezed] = field(default_factory=list)
    outcome: str = "cut short"
    leaf: int | None = None
    reason: str = ""
    audit: str | None = None
    name: str | None = None  # name of the located part, where there are several
    residual: tuple[float, float, float] | None = None  # measured less predicted pose [mm, mm, rad]
    seconds: float | None = None  # time from its first motion to its outcome, if recorded
    phases: list[Phases] = field(default_factory=list)  # seconds of each squeeze, if recorded

    @property
    def failed(self) -> bool:
        """Whether the part did not end in a resolved leaf, or the audit contradicts the leaf."""
        return self.outcome != "leaf" or self.audit == "fail"


class RunLog(NamedTuple):
    """All parts of the runs of one table, in order."""

    parts: list[PartLog]
    runs: int  # number of runs of this table
    others: int  # runs of other tables in the same file, which are ignored
    first: str  # date of the first record
    last: str  # date of the last record

    def branch_counts(self) -> Counter[tuple[int, int | None]]:
        """Number of squeezes for each pair of node and target; the target is None for rejected readings."""
        return Counter((each.node, each.target) for part in self.parts for each in part.squeezes)

    def rejects(self) -> list[tuple[PartLog, Squeezed]]:
        """The parts whose last reading was rejected, each with the squeeze of this reading."""
        last = [(part, part.squeezes[-1]) for part in self.parts if part.squeezes]
        return [(part, squeeze) for part, squeeze in last if squeeze.target is None]

    def outcomes(self) -> Counter[str]:
        """Number of parts with each outcome."""
        return Counter(part.outcome for part in self.parts)

    def times(self, takt_s: float | None = None) -> dict[str, float]:
        """Figures of the seconds that parts took, and the number of timed parts as `parts`.

        With `takt_s`, a takt in seconds, the figures also say how many parts were done in time. The result is
        empty if no part was timed.
        """
        seconds = Counter(part.seconds for part in self.parts if part.seconds is not None)
        return {"parts": seconds.total(), **takt_figures(seconds, takt_s)} if seconds else {}


def read(path: Path, table_sha256: str) -> RunLog:
    """Reads the runs of one table from a journal; `table_sha256` is the digest of the table's file in hex.

    Runs of other tables are only counted.

    Raises:
        InputError: the journal cannot be read, does not verify, or has no run of this table.
    """
    parts: list[PartLog] = []
    runs, others, ours = 0, 0, False
    first = last = ""
    for number, entry in enumerate(_entries(path), 1):
        last = str(entry["time"])
        first = first or last
        if entry["kind"] == "header":
            ours = entry.get("table_sha256") == table_sha256
            begins = "after_part" not in entry  # false for a segment that continues a run
            runs, others = runs + (ours and begins), others + (begins and not ours)
        elif ours:
            try:
                _take(entry, parts)
            except (KeyError, IndexError, TypeError, ValueError) as error:
                problem = f"record {number} is no record of a run; `grasp-journal verify` says why"
                raise InputError(problem, where=str(path)) from error
    if not runs:
        problem = "holds no run of this table; name the table that it was written with"
        raise InputError(problem, where=str(path))
    return RunLog(parts, runs, others, first, last)


def table_of(path: Path) -> TableFile:
    """The table of the first run in a journal.

    Raises:
        InputError: the journal cannot be read or does not verify, or holds no table.
    """
    header = next(_entries(path))
    try:
        data = base64.b64decode(str(header["table_base64"]), validate=True)
        return TableFile(loads(data), data, hashlib.sha256(data).hexdigest())
    except (KeyError, ValueError, TableError) as error:
        raise InputError("does not begin with a run and its table", where=str(path)) from error


def _take(entry: dict[str, Any], parts: list[PartLog]) -> None:
    kind = entry["kind"]
    if kind == "part":
        parts.append(PartLog(int(entry["part"])))
    elif kind == "resume" and parts and entry["how"] == "restart":
        parts[-1].squeezes.clear()
    elif kind == "squeeze":
        target = None if entry["target"] is None else int(entry["target"])
        squeeze = Squeezed(int(entry["node"]), int(entry["width_um"]), target)
        parts[-1].squeezes.append(squeeze)
    elif kind == "audit" and entry.get("residual_theta_rad") is not None:
        x, y, theta = (float(entry[f"residual_{name}"]) for name in ("x_mm", "y_mm", "theta_rad"))
        parts[-1].residual = (x, y, theta)
    elif kind == "outcome":
        part = parts[-1]
        part.outcome, part.leaf = str(entry["outcome"]), entry.get("leaf")
        part.reason, part.audit = str(entry.get("reason") or ""), entry.get("audit")
        part.seconds = None if entry.get("seconds") is None else time_of(entry["seconds"])
        part.phases = [phases_of(record) for record in entry.get("phases", ())]
        part.name = None if entry.get("hypothesis") is None else str(entry["hypothesis"])


def _entries(path: Path) -> Iterator[dict[str, Any]]:
    head = GENESIS
    try:
        for file in (*sealed_segments(path), path):
            for entry in _entries_of(file, head):
                head = str(entry["digest"])
                yield entry
    except OSError as error:
        problem = f"cannot be read: {error.strerror}; check the path"
        raise InputError(problem, where=str(path)) from error
    if head == GENESIS:
        raise InputError("is empty; name the journal of a run", where=str(path))


def _entries_of(path: Path, head: str) -> Iterator[dict[str, Any]]:
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if not line.endswith(b"\n"):
                return  # a crash cut it short; its record was never acted upon
            entry: Any = None
            with suppress(ValueError):
                entry = strict_json.parse(line) if is_intact(line) else None
            known = isinstance(entry, dict) and entry.get("previous") == head
            if not (known and all(isinstance(entry.get(name), str) for name in ("kind", "time"))):
                problem = f"line {number} does not verify; `grasp-journal verify` says why"
                raise InputError(problem, where=str(path))
            head = str(entry["digest"])
            yield entry
