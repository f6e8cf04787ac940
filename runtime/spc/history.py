"""The parts of one or several journals, and the table that they were run with."""

import base64
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from runtime.errors import ArgumentsError, JournalError, TornError
from runtime.journal.chain import records
from runtime.table import Table, loads

Entry = Mapping[str, object]
RESIDUAL = ("residual_x_mm", "residual_y_mm", "residual_theta_rad")


class Squeezed(NamedTuple):
    """One squeeze.

    Attributes:
        node: index of the node.
        branch: index of the branch taken, None for a reject.
        width_um: as read.
    """

    node: int
    branch: int | None
    width_um: int


@dataclass(frozen=True, slots=True)
class Part:
    """One part, from its first squeeze to its end.

    Attributes:
        number: as the run counted it.
        squeezes: in order.
        outcome: "leaf", "reject", "unresolved", "fault" and so on; "" where its run broke off.
        leaf: index of the leaf, None without one.
        verdict: "pass", "fail", "unknown", None where it was not audited.
        residual: measured less predicted pose (mm, mm, rad), None where it was not measured.
        time: of its end, ISO 8601.
    """

    number: int
    squeezes: tuple[Squeezed, ...] = ()
    outcome: str = ""
    leaf: int | None = None
    verdict: str | None = None
    residual: tuple[float, float, float] | None = None
    time: str = ""


@dataclass(frozen=True, slots=True)
class History:
    """Parts in the order in which they were run, and their table.

    Attributes:
        table: of all of them.
        parts: in order.
        table_sha256: digest of the table's bytes; "" where it did not come from a journal.
    """

    table: Table
    parts: tuple[Part, ...]
    table_sha256: str = ""


@dataclass(slots=True)
class _Running:
    """A part that has not ended yet."""

    number: int
    squeezes: list[Squeezed] = field(default_factory=list)
    audit: Entry = field(default_factory=dict)

    def ended(self, entry: Entry, table: Table) -> Part:
        residual = tuple(_number(self.audit.get(name)) for name in RESIDUAL)
        measured = None if None in residual else residual
        verdict, leaf = self.audit.get("verdict", entry.get("audit")), entry.get("leaf")
        if isinstance(leaf, int) and not 0 <= leaf < len(table.leaves):
            raise IndexError(leaf)
        return Part(
            self.number,
            tuple(self.squeezes),
            str(entry.get("outcome", "")),
            leaf if isinstance(leaf, int) else None,
            None if verdict is None else str(verdict),
            measured,  # type: ignore[arg-type]
            str(entry.get("time", "")),
        )


def read(paths: Sequence[Path]) -> History:
    """The history in journals, one after the other.

    Args:
        paths: at least one; all of runs of one table.

    Raises:
        JournalError: one cannot be read, or does not verify.
        ArgumentsError: they are of different tables, or hold no part.
    """
    table: Table | None = None
    digest = ""
    parts: list[Part] = []
    for path in paths:
        for found, data in _runs(_whole_records(path)):
            name = hashlib.sha256(data).hexdigest()
            if table is None:
                table, digest = loads(data), name
            elif name != digest:
                raise ArgumentsError(f"journal {path}: is of another table; report on one table at a time")
            try:
                parts.extend(_parts(found, table))
            except (KeyError, ValueError, IndexError) as error:
                raise JournalError(
                    path, "holds a squeeze or a leaf that is none of its table's; leave it out"
                ) from error
    if table is None or not parts:
        raise ArgumentsError("the journals hold no part yet; run some first")
    return History(table, tuple(parts), digest)


def _whole_records(path: Path) -> Iterator[Entry]:
    """The records of a journal, without a last line that a crash cut short: nothing was done upon that."""
    with suppress(TornError):
        yield from records(path)


def _runs(entries: Iterable[Entry]) -> Iterable[tuple[list[Entry], bytes]]:
    """The records of each run, and the table in its header."""
    run: list[Entry] = []
    data = b""
    for entry in entries:
        if entry["kind"] == "header":
            if run:
                yield run, data
            run, data = [], base64.b64decode(str(entry.get("table_base64", "")))
        else:
            run.append(entry)
    if data:
        yield run, data


def _parts(run: Iterable[Entry], table: Table) -> Iterable[Part]:
    part: _Running | None = None
    for entry in run:
        kind = entry["kind"]
        if kind == "part":
            part = _Running(_whole(entry["part"]))
        elif part is None:
            continue
        elif kind == "squeeze":
            part.squeezes.append(_squeezed(entry, table))
        elif kind == "audit":
            part.audit = entry
        elif kind == "outcome":
            yield part.ended(entry, table)
            part = None


def _squeezed(entry: Entry, table: Table) -> Squeezed:
    node, target = _whole(entry["node"]), entry.get("target")
    if node < 0:
        raise IndexError(node)
    targets = [branch.target for branch in table.nodes[node].branches]
    branch = targets.index(target) if isinstance(target, int) and target in targets else None
    return Squeezed(node, branch, _whole(entry["width_um"]))


def _whole(value: object) -> int:
    return int(str(value))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
