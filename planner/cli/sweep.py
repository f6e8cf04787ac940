"""plan-compile --sweep: one job file, many values, one table each and a summary of them all."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from planner.cli import shell
from planner.errors import UsageError
from planner.sweep import Order, Outcome, Settings, outcomes
from planner.work.scheduler import Scheduler
from runtime.shell.command import INTERRUPTED
from runtime.shell.files import folder, usable, writing

SUFFIX = ".msgpack"
SUMMARY = "summary.json"
LONGEST = 120

_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
_UNFIT = re.compile(r"[^\w.+=,-]+")


class Result(NamedTuple):
    """One job of a sweep, done.

    Attributes:
        order: the job.
        path: where its table is, or would be.
        outcome: what it came to.
    """

    order: Order
    path: Path
    outcome: Outcome

    def row(self) -> dict[str, Any]:
        """Return the job as one object of the summary."""
        result: dict[str, Any] = {"overrides": dict(self.order.overrides)}
        if self.outcome.error is not None:
            message, code = self.outcome.error
            return result | {"error": message, "exit_code": code}
        table = self.outcome.table or b""
        return result | {"table": str(self.path), "bytes": len(table), **self.outcome.figures}


def run(
    orders: Sequence[Order],
    output: Path,
    read: Sequence[Path],
    settings: Settings,
    scheduler: Scheduler,
    as_json: bool,
) -> int:
    """Compiles all orders, writes each table as soon as it is there, and the summary last.

    Args:
        orders: the jobs.
        output: a folder, or a pattern with every swept name in braces.
        read: the job file, and what it names.
        settings: how to compile.
        scheduler: a cluster, or this machine.
        as_json: print the summary as JSON.

    Returns:
        0, or the exit code of the first job that has no table; 130 after Ctrl-C.

    Raises:
        UsageError: the pattern would give two jobs one name.
        OutputError: a file cannot be written, or its folder not be made.
        ClusterError: the cluster was lost.
    """
    paths = paths_of(orders, output)
    summary = folder(paths[0].parent) / SUMMARY
    for path in (*paths, summary):
        usable(path, *read)
    results: list[Result] = []
    try:
        with shell.progress(as_json) as report:
            for order, path, outcome in zip(
                orders, paths, outcomes(orders, settings, scheduler, report), strict=True
            ):
                results.append(Result(order, path, outcome))
                if outcome.table is not None:
                    with writing(path) as draft:
                        draft.write_bytes(outcome.table)
    except KeyboardInterrupt:
        print(f"interrupted; {len(results)} of {len(orders)} jobs are done", file=sys.stderr)
        return INTERRUPTED
    rows = [result.row() for result in results]
    with writing(summary) as draft:
        draft.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if as_json:
        shell.print_json({"jobs": rows})
    else:
        _show(results)
    return next((row["exit_code"] for row in rows if "error" in row), 0)


def paths_of(orders: Sequence[Order], output: Path) -> list[Path]:
    """Return where the tables go.

    Args:
        orders: the jobs.
        output: a folder, whose files are named after the overrides; or, where it ends in .msgpack, a name
            such as "r{uncertainty.radius_mm}.msgpack".

    Raises:
        UsageError: a placeholder names no swept value, one is missing, or names coincide.
    """
    if output.suffix != SUFFIX:
        paths = [
            output / (_fit(",".join(f"{name}={value}" for name, value in order.overrides)) + SUFFIX)
            for order in orders
        ]
    else:
        paths = [_filled(output, dict(order.overrides)) for order in orders]
    path, jobs = Counter(paths).most_common(1)[0]
    if jobs > 1:
        raise UsageError(f"-o {output}: {jobs} jobs would be written to {path}; name every swept value")
    return paths


def _filled(pattern: Path, values: dict[str, str]) -> Path:
    """Return the pattern's file for one job; placeholders stand in its last part only."""
    for name in _PLACEHOLDER.findall(str(pattern)):
        if name not in values:
            raise UsageError(f"-o {pattern}: {{{name}}} is not swept; swept are {', '.join(values)}")
    name = _PLACEHOLDER.sub(lambda match: _fit(values[match[1]]), pattern.name)
    return pattern.with_name(name)


def _fit(text: str) -> str:
    """Return a text as part of a file's name; a digest stands for the rest of a long one."""
    name = _UNFIT.sub("_", text).strip("_")
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 9]}-{digest}"


def _show(results: Sequence[Result]) -> None:
    """Print the summary: a table on a terminal, a line for each job in a pipe."""
    console = Console()
    if not console.is_terminal:
        for result in results:
            print(_line(result))
        return
    names = [name for name, _ in results[0].order.overrides]
    table = Table(*names, "success", "squeezes", "leaves", "s", "table")
    for result in results:
        values = [value for _, value in result.order.overrides]
        if result.outcome.error is not None:
            table.add_row(*values, "", "", "", "", result.outcome.error[0])
            continue
        figures = result.outcome.figures
        table.add_row(
            *values, f"{figures['success_rate']:.2%}", f"{figures['mean_squeezes']:.2f}",
            str(figures["leaves"]), f"{figures['seconds']:.1f}", str(result.path),
        )  # fmt: skip
    console.print(table)


def _line(result: Result) -> str:
    if result.outcome.error is not None:
        return f"{result.order.label}: no table: {result.outcome.error[0]}"
    figures = result.outcome.figures
    return (
        f"{result.order.label}: success {figures['success_rate']:.2%}, "
        f"{figures['mean_squeezes']:.2f} squeezes a part, {figures['leaves']} leaves, wrote {result.path}"
    )
