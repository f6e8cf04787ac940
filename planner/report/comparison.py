"""Two plans, or two runs of one plan, side by side."""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

from planner.evaluation.shares import in_percent, shares_of
from planner.job.model import Job
from planner.report.run_log import RunLog
from planner.report.worlds import evaluation_of
from runtime.table import Table, wilson_interval

LONGEST = 60  # characters shown of a job's value


class Row(NamedTuple):
    """One quantity of both plans, or of both runs, as text."""

    name: str
    this: str
    other: str


class Comparison(NamedTuple):
    """The comparison of two plans, or of two runs, row by row, with their names."""

    this: str
    other: str
    rows: list[Row]


class Plan(NamedTuple):
    """A table with its job, and the name of its file."""

    name: str
    table: Table
    job: Job


def of_plans(this: Plan, other: Plan, trials: int) -> Comparison:
    """Compares two plans by the figures of their tables, and by the keys in which their jobs differ.

    Each table is evaluated again, with as many trials as gave its stored figures; a table without figures is
    evaluated with `trials` trials.
    """
    columns = [dict(_plan_figures(plan, trials)) for plan in (this, other)]
    jobs = [_flat(json.loads(plan.job.canonical())) for plan in (this, other)]
    rows = [Row(name, value, columns[1][name]) for name, value in columns[0].items()]
    for key in sorted(jobs[0].keys() | jobs[1].keys()):
        values = [_short(job.get(key)) for job in jobs]
        if jobs[0].get(key) != jobs[1].get(key):
            rows.append(Row(f"job: {key}", *values))
    return Comparison(this.name, other.name, rows)


def of_runs(this: tuple[str, RunLog], other: tuple[str, RunLog]) -> Comparison:
    """Compares the runs in two journals of one table; each argument is a journal's name and its content."""
    columns = [dict(_run_figures(log)) for _, log in (this, other)]
    names = list(dict.fromkeys([*columns[0], *columns[1]]))
    rows = [Row(name, *(column.get(name, "0") for column in columns)) for name in names]
    return Comparison(this[0], other[0], rows)


def _plan_figures(plan: Plan, trials: int) -> Iterator[tuple[str, str]]:
    figures = evaluation_of(plan.table, plan.job, trials).summary()
    shares, (low, high) = shares_of(figures), figures["success_ci95"]
    yield "located", f"{in_percent(shares.located)} ({100 * low:.2f} to {100 * high:.2f} %)"
    yield "wrong", in_percent(shares.wrong)
    yield "unresolved", in_percent(shares.unresolved)
    yield "rejected", in_percent(shares.rejected)
    error = figures["error_mm"]
    yield "error, median", f"{error['median']:.2f} mm" if error else "none located"
    yield "error, 95 %", f"{error['p95']:.2f} mm" if error else "none located"
    yield "squeezes a part", f"{figures['mean_squeezes']:.2f}"
    yield "seconds a part", f"{figures['seconds_mean']:.1f}"
    yield "nodes, leaves", f"{len(plan.table.nodes)}, {len(plan.table.leaves)}"


def _run_figures(log: RunLog) -> Iterator[tuple[str, str]]:
    total = len(log.parts)
    located = sum(not part.failed for part in log.parts)
    low, high = wilson_interval(located, total)
    yield "parts", str(total)
    yield "located", f"{located} ({100 * low:.1f} to {100 * high:.1f} %)"
    for outcome, number in log.outcomes().most_common():
        yield f"ended as {outcome}", str(number)
    squeezes = sum(len(part.squeezes) for part in log.parts)
    yield "squeezes a part", f"{squeezes / max(total, 1):.2f}"
    times = log.times()
    yield "seconds a part", f"{times['seconds_mean']:.1f}" if times else "not measured"


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Flattens a nested object to dotted keys."""
    if not isinstance(value, dict):
        return {name: value}
    pairs = (_flat(inner, f"{name}.{key}" if name else key) for key, inner in value.items())
    return {key: inner for pair in pairs for key, inner in pair.items()}


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}\u2026"
