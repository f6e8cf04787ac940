"""Reads the parts that one or several journals recorded, and the table that those runs used."""

import base64
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from runtime.errors import JournalError, TornError
from runtime.journal.chain import records
from runtime.journal.lines import Entry
from runtime.shell.errors import UsageError
from runtime.shell.sealed_lines import check_distinct
from runtime.table import Pose2, Table, loads, turned_pose

RESIDUAL = ("residual_x_mm", "residual_y_mm", "residual_theta_rad")


class NodeReading(NamedTuple):
    """The width that was read at a node, and the branch that the part took there."""

    node: int  # index of the node
    branch: int | None  # index of the branch at the node; None for a reject
    width_um: int


@dataclass(frozen=True, slots=True)
class Part:
    """What the journal recorded of one part: readings, outcome, and the audit's verdict."""

    number: int  # number of the part in its run, from 1
    squeezes: tuple[NodeReading, ...] = ()
    # "leaf", "reject", "unresolved", "fault" and so on; "" before the part has ended
    outcome: str = ""
    leaf: int | None = None  # index of the leaf at which the part ended; None if it ended at none
    verdict: str | None = None  # "pass", "fail" or "unknown"; None if the part was not audited
    # measured minus predicted pose (mm, mm, rad), turned back with the part's plan; None if the pose was
    # not measured
    residual: tuple[float, float, float] | None = None
    time: str = ""  # when the part ended, ISO 8601
    # true pose of a simulated part (mm, mm, rad), turned back with the part's plan; None if it was not
    # recorded
    true: Pose2 | None = None
    # whether the leaf's predicted pose is within the goal of the true pose; None if unknown
    within: bool | None = None
    turn_rad: float = 0.0  # angle by which the part's plan was turned about the origin


@dataclass(frozen=True, slots=True)
class History:
    """The parts of several runs of one table."""

    table: Table
    parts: tuple[Part, ...]  # in the order of the runs
    table_sha256: str = ""  # digest of the table's file; "" if the history is not from a journal


def read(paths: Sequence[Path]) -> History:
    """Reads several journals, in the order given; returns their parts and their common table.

    Raises:
        JournalError: a journal cannot be read, does not verify, or disagrees with its table.
        UsageError: the journals have different tables, or no parts, or a run in common.
    """
    check_distinct(paths)
    table: Table | None = None
    digest = ""
    parts: list[Part] = []
    for path in paths:
        running: Part | None = None
        audit: Entry = {}
        try:
            for entry in _whole_records(path):
                kind = entry["kind"]
                if kind == "header":
                    if table is None:
                        digest = str(entry["table_sha256"])
                        table = loads(base64.b64decode(str(entry["table_base64"])))
                    elif digest != entry["table_sha256"]:
                        message = "is of another table; report on one table at a time"
                        raise UsageError(f"journal {path}: {message}")
                    running = None
                elif kind == "truth" and parts and running is None:
                    parts[-1] = _with_truth(parts[-1], entry)
                elif kind == "part":
                    running, audit = Part(_whole(entry["part"])), {}
                elif table is None or running is None:
                    continue
                elif kind == "squeeze":
                    squeezes = (*running.squeezes, _reading(entry, table))
                    running = replace(running, squeezes=squeezes)
                elif kind == "turned":
                    running = replace(running, turn_rad=_whole(entry["turn_urad"]) / 1e6)
                elif kind == "audit":
                    audit = entry
                elif kind == "outcome":
                    parts.append(_ended(running, audit, entry, table))
                    running = None
        except (KeyError, ValueError, IndexError) as error:
            message = "has a record that does not fit its table; leave the journal out"
            raise JournalError(path, message) from error
    if table is None or not parts:
        raise UsageError("the journals hold no part yet; run some first")
    return History(table, tuple(parts), digest)


def by_leaf(parts: Iterable[Part]) -> list[tuple[int, list[Part]]]:
    """Groups parts by the leaf at which they ended; returns pairs of a leaf's index and its parts."""
    result: dict[int, list[Part]] = {}
    for part in parts:
        if part.leaf is not None:
            result.setdefault(part.leaf, []).append(part)
    return sorted(result.items())


def _whole_records(path: Path) -> Iterator[Entry]:
    """Yields the complete records of a journal.

    An incomplete last line is left out: a crash interrupted the writing. The cell has not acted on this line,
    since it acts on a record only after the record is written.
    """
    with suppress(TornError):
        yield from records(path)


def _ended(part: Part, audit: Entry, entry: Entry, table: Table) -> Part:
    x, y, theta = (_number(audit.get(name)) for name in RESIDUAL)
    verdict, leaf = audit.get("verdict", entry.get("audit")), entry.get("leaf")
    if isinstance(leaf, int) and not 0 <= leaf < len(table.leaves):
        raise IndexError(leaf)
    off = None
    if x is not None and y is not None and theta is not None:
        off = (*turned_pose((x, y, 0.0), -part.turn_rad)[:2], theta)
    return replace(
        part,
        outcome=str(entry.get("outcome", "")),
        leaf=leaf if isinstance(leaf, int) else None,
        verdict=None if verdict is None else str(verdict),
        residual=off,
        time=str(entry.get("time", "")),
    )


def _with_truth(part: Part, entry: Entry) -> Part:
    x_um, y_um, theta_urad = (_whole(entry[name]) for name in ("x_um", "y_um", "theta_urad"))
    within = entry.get("within_goal")
    true = turned_pose((x_um / 1e3, y_um / 1e3, theta_urad / 1e6), -part.turn_rad)
    return replace(part, true=true, within=within if isinstance(within, bool) else None)


def _reading(entry: Entry, table: Table) -> NodeReading:
    node, target = _whole(entry["node"]), entry.get("target")
    if node < 0:
        raise IndexError(node)
    return NodeReading(node, table.nodes[node].branch_to(target), _whole(entry["width_um"]))


def _whole(value: object) -> int:
    return int(str(value))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
