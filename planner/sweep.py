"""Many jobs at once: one job file, with every combination of some of its values.

Each table is the one that its job alone compiles to. A combination that cannot be used, or has no plan, is
one outcome among the others.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from planner.compile import Plan, compile_job
from planner.errors import PlannerError, UsageError
from planner.job import documents
from planner.job import model as job_file
from planner.job.overrides import changes_of, split
from planner.learned.store import Store
from planner.work.progress import Report
from planner.work.scheduler import Cluster, Scheduler
from runtime.table import dumps

MOST_JOBS = 10_000

Overrides = tuple[tuple[str, str], ...]


class Settings(NamedTuple):
    """How every job of a sweep is compiled.

    Attributes:
        trials: parts squeezed to evaluate a table.
        workers: threads for a job; all cores if None.
        strip: leave the jobs out of the tables.
        cache: folder of the roll-outs, on the machine that compiles; none are kept if None.
        budget_s: for each job; its tree is left as it stands then.
    """

    trials: int
    workers: int | None = None
    strip: bool = False
    cache: Path | None = None
    budget_s: float = math.inf


class Order(NamedTuple):
    """One job of a sweep.

    Attributes:
        overrides: names and values' texts that make it.
        text: its canonical text; "" if it was refused.
        error: why, and the exit code; None if it was not.
    """

    overrides: Overrides
    text: str
    error: tuple[str, int] | None = None

    @property
    def label(self) -> str:
        """The overrides as one text, which no other job of the sweep has."""
        return ", ".join(f"{name}={value}" for name, value in self.overrides)


class Outcome(NamedTuple):
    """What one job came to.

    Attributes:
        table: the bytes of its decision table; None if there is none.
        figures: what is known about the table, as `figures_of` returns it.
        error: why there is no table, and the exit code.
    """

    table: bytes | None
    figures: dict[str, Any]
    error: tuple[str, int] | None


def orders_of(path: Path, sweeps: Sequence[str], common: Overrides = ()) -> list[Order]:
    """Return one order for every combination of the swept values, the last name's values changing fastest.

    Args:
        path: the job file.
        sweeps: texts "section.key=value,value".
        common: overrides of all jobs, applied first.

    Raises:
        UsageError: a text cannot be read, a name is swept twice, or there are too many combinations.
        InputFileError: the job file cannot be read.
        TomlError: it is not TOML.
    """
    axes = [split(text) for text in sweeps]
    names = [name for name, _ in axes]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"--sweep {name}: swept twice; state all its values at once")
    text = documents.read(path)
    documents.from_toml(text, str(path))
    total = 1
    for _, values in axes:
        total *= len(values)
    if total > MOST_JOBS:
        raise UsageError(f"--sweep: {total} combinations are more than {MOST_JOBS}; sweep fewer values")
    combinations = itertools.product(*(values for _, values in axes))
    chosen = [tuple(zip(names, values, strict=True)) for values in combinations]
    return [_order(text, str(path), common, overrides) for overrides in dict.fromkeys(chosen)]


def outcomes(
    orders: Sequence[Order], settings: Settings, scheduler: Scheduler, report: Report
) -> Iterator[Outcome]:
    """Compiles the orders and yields what each came to, in their order.

    On a cluster a job is a task with one thread. On this machine jobs follow one another, each with all
    threads: processes side by side would load the kernels anew each, for no gain in speed.

    Args:
        orders: what to compile.
        settings: how.
        scheduler: a cluster, or else it does not matter.
        report: told about progress.

    Raises:
        ClusterError: the cluster was lost.
    """
    if isinstance(scheduler, Cluster):
        task = partial(compiled, settings._replace(workers=1))
        report("jobs", 0, len(orders))
        for k, outcome in enumerate(scheduler.map(task, orders)):
            report("jobs", k + 1, len(orders))
            yield outcome
        return
    for k, order in enumerate(orders):
        yield compiled(settings, order, partial(_told, report, f"job {k + 1} of {len(orders)}"))


def compiled(settings: Settings, order: Order, report: Report | None = None) -> Outcome:
    """Compiles one order, wherever it runs; what goes wrong becomes its outcome."""
    if order.error is not None:
        return Outcome(None, {}, order.error)
    started = time.perf_counter()
    try:
        job = job_file.from_canonical(order.text)
        store = None if settings.cache is None else Store(settings.cache)
        plan = compile_job(job, settings.workers, settings.trials, report, settings.budget_s, store)
    except PlannerError as error:
        return Outcome(None, {}, (str(error), error.exit_code))
    except Exception as error:
        problem = f"internal error, {type(error).__name__}: {error}; please report it"
        return Outcome(None, {}, (problem, PlannerError.exit_code))
    table = dataclasses.replace(plan.table, job=None) if settings.strip else plan.table
    return Outcome(dumps(table), figures_of(plan, time.perf_counter() - started), None)


def figures_of(plan: Plan, seconds: float) -> dict[str, Any]:
    """Return what there is to say about a plan that took so long, in plain types."""
    return {
        "nodes": len(plan.table.nodes),
        "leaves": len(plan.table.leaves),
        "untried_branches": plan.untried,
        "unresolved_leaves": sum(not leaf.resolved for leaf in plan.table.leaves),
        "seconds": round(seconds, 3),
        **plan.evaluation.summary(),
    }


def _order(text: str, where: str, common: Overrides, overrides: Overrides) -> Order:
    try:
        changes = changes_of(f"{name}={value}" for name, value in (*common, *overrides))
        return Order(overrides, job_file.parse(text, where, changes).canonical())
    except PlannerError as error:
        return Order(overrides, "", (str(error), error.exit_code))


def _told(report: Report, prefix: str, stage: str, done: int, total: int) -> None:
    report(f"{prefix}: {stage}", done, total)
