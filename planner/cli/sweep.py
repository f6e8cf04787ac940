"""plan-compile --vary: one table for every combination of some values, and a summary.

A combination that is invalid or has no plan is an outcome like any other.
"""

import dataclasses
import hashlib
import itertools
import json
import math
import re
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from planner.cli import course, shell
from planner.compile import Plan, compile_job
from planner.job import documents
from planner.job import model as job_file
from planner.job.overrides import changes_of, split
from planner.work.limit import Limit
from planner.work.progress import Report
from planner.work.scheduler import Cluster, Scheduler
from runtime.shell.errors import ExpectedError, UsageError
from runtime.shell.exit_codes import ExitCode
from runtime.shell.files import folder, usable, write, writing
from runtime.table import dumps, takt_text

SUFFIX = ".msgpack"
SUMMARY = "summary.json"
LONGEST = 120
MOST_JOBS = 10_000

Overrides = tuple[tuple[str, str], ...]

_UNFIT = re.compile(r"[^\w.+=,-]+")


class Settings(NamedTuple):
    """Settings that all jobs of a sweep share."""

    trials: int  # parts squeezed to evaluate a table
    workers: int | None  # threads for a job; all cores if None
    strip: bool  # leave the jobs out of the tables
    budget_s: float  # time for each job; the best tree at its end is kept
    takt_s: float | None  # time within which parts should be done


class Order(NamedTuple):
    """One job of a sweep."""

    overrides: Overrides  # names of keys, each with the text of its value
    text: str  # canonical text of the job; "" if it was refused
    refusal: dict[str, Any] | None = None  # the error, as `_failure` returns it

    @property
    def label(self) -> str:
        """The overrides as one text, unique within the sweep."""
        return ", ".join(f"{name}={value}" for name, value in self.overrides)


class Outcome(NamedTuple):
    """The table of one job of a sweep, or the error in place of it."""

    table: bytes | None  # bytes of the decision table; None if there is none
    figures: dict[str, Any]  # from `figures_of` or, without a table, `_failure`


def orders_of(path: Path, sweeps: Sequence[str], common: Overrides = ()) -> list[Order]:
    """Returns an order for every combination of the swept values; the value of the last name changes fastest.

    `sweeps` are texts "section.key=value,value". The overrides `common` apply to all jobs, before the swept
    values do.

    Raises:
        UsageError: a text cannot be read, a name is swept twice, or there are too many combinations.
        InputError: the job file cannot be read, or is not TOML.
    """
    axes = [split(text) for text in sweeps]
    names = [name for name, _ in axes]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"--vary {name}: swept twice; state all its values at once")
    text = documents.read(path)
    documents.from_toml(text, str(path))
    total = math.prod(len(values) for _, values in axes)
    if total > MOST_JOBS:
        most = f"more than {MOST_JOBS}; sweep fewer values"
        raise UsageError(f"--vary: {total} combinations are {most}")
    combinations = itertools.product(*(values for _, values in axes))
    chosen = [tuple(zip(names, values, strict=True)) for values in combinations]
    return [_order(text, str(path), common, overrides) for overrides in dict.fromkeys(chosen)]


def outcomes(
    orders: Sequence[Order], settings: Settings, scheduler: Scheduler, report: Report
) -> Iterator[Outcome]:
    """Compiles the jobs of a sweep and yields their outcomes in order.

    On a cluster a job is a task with one thread. On this machine jobs run one after the other, each with all
    threads: parallel processes would each load the kernels, for no gain in speed.

    Raises:
        UnreachableError: the connection to the cluster was lost.
    """
    if isinstance(scheduler, Cluster):
        task = partial(compiled, settings._replace(workers=1))
        report("jobs", 0, len(orders))
        for k, outcome in enumerate(scheduler.map(task, orders)):
            report("jobs", k + 1, len(orders))
            yield outcome
        return
    for k, order in enumerate(orders, start=1):
        yield compiled(settings, order, _of_job(k, len(orders), report))


def _of_job(number: int, jobs: int, report: Report) -> Report:
    """Returns a function that reports a stage of job `number` as progress in a sweep of `jobs` jobs."""

    def report_stage(stage: str, _done: int, _total: int, detail: str = "", /) -> None:
        report(f"job {number} of {jobs}: {stage}", number - 1, jobs, detail)

    return report_stage


def compiled(settings: Settings, order: Order, report: Report | None = None) -> Outcome:
    """Compiles one job of a sweep, on this machine or on a cluster; errors are returned as outcomes."""
    if order.refusal is not None:
        return Outcome(None, order.refusal)
    started = time.perf_counter()
    try:
        job = job_file.from_canonical(order.text)
        limit = Limit(settings.budget_s)
        plan = compile_job(job, settings.workers, settings.trials, report, limit)
    except ExpectedError as error:
        return Outcome(None, _failure(error))
    except Exception as error:
        problem = f"internal error, {type(error).__name__}: {error}; please report it"
        return Outcome(None, {"error": problem, "exit_code": ExitCode.INTERNAL})
    table = dataclasses.replace(plan.table, job=None) if settings.strip else plan.table
    return Outcome(dumps(table), figures_of(plan, time.perf_counter() - started, settings.takt_s))


def figures_of(plan: Plan, seconds: float, takt_s: float | None) -> dict[str, Any]:
    """The figures of a plan as JSON types: sizes, compile time, and those of `Evaluation.summary`."""
    pushes = sum(len(node.pushes) for node in plan.table.nodes)
    return {
        "nodes": len(plan.table.nodes),
        **({"pushes": pushes} if pushes else {}),
        "leaves": len(plan.table.leaves),
        "untried_branches": plan.untried,
        "unresolved_leaves": sum(not leaf.resolved for leaf in plan.table.leaves),
        "seconds": round(seconds, 3),
        "cut_short": plan.cut and plan.cut.figures(),
        "trials_seed": plan.seed,
        **plan.evaluation.summary(takt_s),
    }


def run(
    orders: Sequence[Order],
    output: Path,
    read: Sequence[Path],
    settings: Settings,
    scheduler: Scheduler,
    as_json: bool,
) -> int:
    """Compiles all orders, writes their tables to the folder `output`, and at the end a summary of all.

    Each table is written as soon as it is compiled. `read` are the job file and the files that it names;
    these must not be overwritten.

    Returns:
        0, or the exit code of the first job that has no table; 130 after Ctrl-C.

    Raises:
        UsageError: see `paths_of`.
        OutputError: a file cannot be written, or its folder cannot be created.
        UnreachableError: the connection to the cluster was lost.
    """
    paths = paths_of(orders, output)
    summary = folder(paths[0].parent) / SUMMARY
    for path in (*paths, summary):
        usable(path, *read)
    rows: list[dict[str, Any]] = []
    try:
        with shell.progress(as_json, course.counted) as report:
            all_outcomes = outcomes(orders, settings, scheduler, report)
            for order, path, (table, figures) in zip(orders, paths, all_outcomes, strict=True):
                row: dict[str, Any] = {"overrides": dict(order.overrides)}
                rows.append(row)
                if table is not None:
                    row |= {"table": str(path), "bytes": len(table)}
                    with writing(path) as draft:
                        draft.write_bytes(table)
                row |= figures
    except KeyboardInterrupt:
        print(f"interrupted; {len(rows)} of {len(orders)} jobs are done", file=sys.stderr)
        return ExitCode.INTERRUPTED
    write(summary, json.dumps(rows, indent=1) + "\n")
    if as_json:
        shell.answer(True, {"jobs": rows})
    else:
        _show(orders, rows)
    return next((row["exit_code"] for row in rows if "error" in row), 0)


def paths_of(orders: Sequence[Order], folder: Path) -> list[Path]:
    """The paths of the tables, each named after its values.

    Raises:
        UsageError: the folder is named like a table, or names coincide.
    """
    if folder.suffix == SUFFIX:
        raise UsageError(f"-o {folder}: --vary writes a table for each value; name a folder")
    labels = [",".join(f"{name}={value}" for name, value in order.overrides) for order in orders]
    paths = [folder / (_fit(label) + SUFFIX) for label in labels]
    path, jobs = Counter(paths).most_common(1)[0]
    if jobs > 1:
        raise UsageError(f"--vary: {jobs} jobs would be written to {path}; vary fewer values")
    return paths


def _fit(text: str) -> str:
    """Converts a text to a file name; a digest replaces the rest of a long text."""
    name = _UNFIT.sub("_", text).strip("_")
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 9]}-{digest}"


def _show(orders: Sequence[Order], rows: Sequence[dict[str, Any]]) -> None:
    console = Console()
    table = Table(*rows[0]["overrides"], "success", "squeezes", "leaves", "s", "table")
    for order, row in zip(orders, rows, strict=True):
        values = row["overrides"].values()
        if "error" in row:
            line = f"no table: {row['error']}"
            table.add_row(*values, "", "", "", "", row["error"])
        else:
            success, squeezes = f"{row['success_rate']:.2%}", f"{row['mean_squeezes']:.2f}"
            line = f"success {success}, {squeezes} squeezes a part, {row['leaves']} leaves"
            line += f", {takt_text(row)}" if "takt_s" in row else ""
            line += f", wrote {row['table']}"
            if row["cut_short"]:
                share = f"cut short, {row['cut_short']['open_share']:.2%}"
                line = f"{share} of the parts still open; {line}"
                success = f"{success} ({share} open)"
            seconds = f"{row['seconds']:.1f}"
            table.add_row(*values, success, squeezes, str(row["leaves"]), seconds, row["table"])
        if not console.is_terminal:
            print(f"{order.label}: {line}")
    if console.is_terminal:
        console.print(table)


def _order(text: str, where: str, common: Overrides, overrides: Overrides) -> Order:
    try:
        changes = changes_of(f"{name}={value}" for name, value in (*common, *overrides))
        return Order(overrides, job_file.parse(text, where, changes).canonical())
    except ExpectedError as error:
        return Order(overrides, "", _failure(error))


def _failure(error: ExpectedError) -> dict[str, Any]:
    return {"error": str(error), "exit_code": error.exit_code}
