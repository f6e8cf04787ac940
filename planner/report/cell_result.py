"""What a cell made of a table, in one sentence: how many parts ended how, and where most were rejected."""

from collections import Counter
from typing import Literal, NamedTuple

from planner.report.run_log import PartLog, RunLog
from planner.report.tree import names_parts
from runtime.table import Calibration, Node, Table

FAR_MM = 2.0  # from every planned width: not noise, but another part or another lie
USUAL = 0.9  # share of located parts below which a cell needs a look


class CellResult(NamedTuple):
    """The cell's own result."""

    grade: Literal["good", "fair", "poor"]
    sentence: str


def cell_result(table: Table, log: RunLog) -> CellResult:
    """How the parts of a journal ended, and what the commonest reject looks like."""
    total = len(log.parts)
    if not total:
        return CellResult("fair", "no part was begun")
    located = sum(not part.failed for part in log.parts)
    told = f"{located} of {total} parts {'named' if table.goal.kind == 'identity' else 'located'}"
    told += _names_told(log.parts) if names_parts(table) else ""
    wrong = sum(part.audit == "fail" for part in log.parts)
    told += f", {wrong} of them found elsewhere by the audit" if wrong else ""
    others = Counter(part.outcome for part in log.parts if part.outcome != "leaf")
    told += "".join(f", {number} {outcome}" for outcome, number in others.most_common())
    worst = _commonest_reject(log.parts)
    if worst is not None:
        node, counts = worst
        middle = sorted(counts)[len(counts) // 2]
        told += f"; {len(counts)} rejected at node {node}: {reject_told(table, node, middle)}"
    share = located / total
    return CellResult("good" if share == 1.0 else "fair" if share >= USUAL else "poor", told)


def reject_told(table: Table, node: int, count: int) -> str:
    """What was read where the table has no branch, and what was planned there."""
    read_mm = Calibration.linear(table.gripper).width_um(count) / 1e3
    spans = planned_spans(table.nodes[node])
    planned = ", ".join(f"{low:.1f} to {high:.1f}" for low, high in spans)
    off = min(max(low - read_mm, read_mm - high, 0.0) for low, high in spans)
    return f"{read_mm:.1f} mm read, {planned} planned" + (": another part?" if off > FAR_MM else "")


def planned_spans(node: Node) -> list[tuple[float, float]]:
    """The widths that a node has branches for, those that meet put together [mm]."""
    spans: list[tuple[float, float]] = []
    for branch in sorted(node.branches, key=lambda branch: branch.low_um):
        low, high = branch.low_um / 1e3, branch.high_um / 1e3
        if spans and low <= spans[-1][1]:
            spans[-1] = (spans[-1][0], max(high, spans[-1][1]))
        else:
            spans.append((low, high))
    return spans


def _names_told(parts: list[PartLog]) -> str:
    """How often each name was given, in brackets."""
    names = Counter(part.name for part in parts if part.outcome == "leaf" and part.name is not None)
    return f" ({', '.join(f'{number} {name}' for name, number in names.most_common())})" if names else ""


def _commonest_reject(parts: list[PartLog]) -> tuple[int, list[int]] | None:
    """The node that rejected most parts, and the counts that it read."""
    last = [part.squeezes[-1] for part in parts if part.squeezes and part.squeezes[-1][2] is None]
    if not last:
        return None
    node, _ = Counter(node for node, _, _ in last).most_common(1)[0]
    return node, [count for at, count, _ in last if at == node]
