"""plan-compile: job file in, decision table out."""

import argparse
import dataclasses
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from planner.cli import bounds, course, shell, sweep
from planner.cli.sweep import Settings, figures_of, orders_of
from planner.compile import EVALUATION_TRIALS, Plan, compile_job
from planner.diagnosis.advice import counsel
from planner.diagnosis.alike import alike, refuse_alike
from planner.diagnosis.cautions import hardly_located, warnings_of
from planner.evaluation.shares import shares_of
from planner.job import model as job_file
from planner.job.model import Job
from planner.paper import baseline
from planner.paper.search import METHODS
from planner.part import tips
from planner.work.limit import Limit
from runtime.shell import files
from runtime.shell.command import Parser, natural, tell
from runtime.shell.command import seconds as seconds_text
from runtime.shell.errors import UsageError
from runtime.shell.exit_codes import ExitCode
from runtime.table import dump, takt_text

NAME = "plan-compile"


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Plan the squeezes that locate a part, and write them as a decision table.",
        f"{NAME} trees/rectangle/job.toml -o rectangle.msgpack",
        f"{NAME} job.toml -o tables --vary uncertainty.radius_mm=5,10",
        f"{NAME} job.toml -o tree.msgpack --bound",
        f"{NAME} job.toml --baseline sensorless",
    )
    add = built.add_argument
    add("job", type=Path, metavar="JOB.toml", help="the job file")
    shell.add_output(built, "TREE.msgpack", "the table; with --vary a folder", required=False)
    text = "one table for each value in place of the job's; given twice, for each combination"
    add("--vary", action="append", default=[], metavar="SECTION.KEY=VALUE,VALUE", help=text)
    add("--seed", type=natural, help="seed in place of the job's")
    shell.add_trials(built, EVALUATION_TRIALS, "parts squeezed to evaluate the table")
    text = (
        "end after this time, evaluation included, with the best tree so far; Ctrl-C does so at once "
        "(default: search until done)"
    )
    add("--budget", type=seconds_text, default=math.inf, metavar="60s", help=text)
    bounds.add_options(built)
    add("--strip", action="store_true", help="leave the job out of the table")
    text = "skip the search for what limits the plan, which takes seconds"
    add("--no-advice", action="store_true", help=text)
    text = "write no table; print Goldberg's plan without sensors, and what it achieves"
    add("--baseline", choices=["sensorless"], help=text)
    shell.add_takt(built)
    shell.add_scheduler(built)
    return built


def _compile(arguments: argparse.Namespace) -> int:
    shell.refuse(_mistakes(arguments))
    if arguments.vary:
        return _sweep(arguments)
    return _baseline(arguments) if arguments.baseline else _single(arguments)


def _mistakes(arguments: argparse.Namespace) -> Iterator[str]:
    bounded = arguments.bound or arguments.bound_dense
    if arguments.baseline:
        if arguments.output or arguments.vary:
            yield "--baseline writes no table; leave out -o and --vary"
        if bounded:
            yield "--bound: is for a table, and --baseline writes none; leave one of them out"
        if arguments.takt is not None:
            yield "--takt: is for the parts of a table; leave it out with --baseline"
    elif not arguments.output:
        yield "-o/--output is missing; name the table to write"
    if arguments.vary and bounded:
        yield "--bound: is for a single plan; leave it out with --vary"


def _single(arguments: argparse.Namespace) -> int:
    """Compiles the job file to one table, for a command line without --vary; returns the exit code."""
    started = time.perf_counter()
    job = _job(arguments)
    read = job_file.files(arguments.job)
    what = "a table, which squeezetree report draws"
    output = files.fitting(arguments.output, what, ".msgpack")
    files.usable(output, *read)
    bounded = math.isfinite(arguments.budget)
    whole = course.of_time(arguments.budget) if bounded else course.of_search
    refuse_alike(job)
    for result in alike(job):
        tell(NAME, f"warning: {result.line()}")
    limit, notes = Limit(arguments.budget), list[str]()
    with shell.scheduler(arguments) as scheduler, shell.progress(arguments.json, whole) as report:
        with shell.stopping(limit, NAME):
            plan = compile_job(job, arguments.workers, arguments.trials, report, limit, scheduler)
        dump(dataclasses.replace(plan.table, job=None) if arguments.strip else plan.table, output)
        seconds = time.perf_counter() - started
        bound = advice = None
        with shell.spared("bound", notes, arguments.debug):
            bound = bounds.bound_of(arguments, job, plan.table, arguments.workers, report)
        # A longer search might contradict advice on a plan that was cut short.
        if not (arguments.no_advice or plan.cut):
            with shell.spared("advice", notes, arguments.debug):
                advice = counsel(plan.table, plan.evaluation, job, scheduler, report)
    written = {"table": str(output), "bytes": output.stat().st_size}
    figures = written | figures_of(plan, seconds, arguments.takt)
    lines = [*_lines(plan, job, figures), *(advice.lines() if advice else ())]
    if bound:
        lines += bound.lines()
        figures |= {"squeezes_lower_bound": bound.squeezes, "bound": bound.figures()}
    figures["advice"] = advice and advice.figures()
    for note in notes:
        tell(NAME, f"{note}; {output} is written")
    shell.answer(arguments.json, figures, *lines)
    return ExitCode.INTERRUPTED if plan.cut and plan.cut.asked else 0


def _baseline(arguments: argparse.Namespace) -> int:
    job = _job(arguments)
    with shell.scheduler(arguments) as scheduler:
        result = baseline.sensorless(job, arguments.trials, scheduler)
    shell.answer(arguments.json, result.figures(), baseline.text(job.name, result))
    return 0


def _job(arguments: argparse.Namespace) -> Job:
    job = job_file.load(arguments.job)
    for option in ("baseline", "bound", "bound_dense"):
        if getattr(arguments, option):
            name = f"--{option.replace('_', '-')}"
            shell.check_one_part(job.hypothesis, str(arguments.job), name)
    if job.search.method in METHODS and math.isfinite(arguments.budget):
        problem = f'{arguments.job} has search.method = "{job.search.method}"'
        raise UsageError(f"{problem}, which no --budget ends early; leave --budget out")
    if job.actions.pushes and (arguments.bound or arguments.bound_dense):
        has = f'{arguments.job} has actions.pushes = "belief"'
        raise UsageError(f"--bound is for squeezes alone; {has}")
    return job if arguments.seed is None else dataclasses.replace(job, seed=arguments.seed)


def _sweep(arguments: argparse.Namespace) -> int:
    common = () if arguments.seed is None else (("seed", str(arguments.seed)),)
    orders = orders_of(arguments.job, arguments.vary, common)
    settings = Settings(
        arguments.trials, arguments.workers, arguments.strip, arguments.budget, arguments.takt
    )
    with shell.scheduler(arguments) as scheduler:
        read = job_file.files(arguments.job)
        return sweep.run(orders, arguments.output, read, settings, scheduler, arguments.json)


def _lines(plan: Plan, job: Job, figures: dict[str, Any]) -> Iterator[str]:
    shares, error = shares_of(figures), figures["error_mm"]
    low, high = figures["success_ci95"]
    if plan.cut:
        yield plan.cut.line()
    leaves = f"{figures['leaves']} leaves"
    if "pushes" in figures:
        leaves = f"{figures['pushes']} pushes before them, {leaves}"
    if figures["unresolved_leaves"]:
        leaves += f", {figures['unresolved_leaves']} of them unresolved"
    yield f"{job.name}: {figures['nodes']} squeezes planned, {leaves}"
    if plan.untried:
        yield f"branches that no trial took, and that are REJECT now: {plan.untried}"
    if figures["crashes"]:
        crashes = f"{figures['crashes']} ({shares.crashed:.2f}%)"
        yield f"parts that a finger came down on, which count as failures: {crashes}"
    interval = f"(95 % interval {low:.2%} to {high:.2%})"
    yield f"success {shares.located:.2f}% of {figures['trials']} fresh trials {interval}"
    rest = f"unresolved {shares.unresolved:.2f}%, wrong {shares.wrong:.2f}%"
    yield f"rejected {shares.rejected:.2f}%, {rest}"
    squeezes = f"{figures['mean_squeezes']:.2f} squeezes a part"
    most, seconds = plan.table.limits.max_depth, figures["seconds_mean"]
    yield f"{squeezes}, {most} at most; about {seconds:.1f} s"
    if "takt_s" in figures:
        yield takt_text(figures)
    yield f"error {error['median']:.2f} mm median, 95 % within {error['p95']:.2f} mm, where resolved"
    if low := [alone.name for alone in job.alone if alone.part.height_mm is None]:
        tips_mm = job.cell.squeeze_height_mm
        met = f"tips at squeeze_height_mm = {tips_mm:g} meet a part of {tips_mm + tips.MARGIN_MM:g} mm"
        of = f" of {' and '.join(low)}" if job.hypothesis else " of [part]"
        yield f"height_mm{of} is not stated: {met} or more"
    for line in (*hardly_located(plan.evaluation), *warnings_of(job)):
        yield f"warning: {line}"
    yield f"wrote {figures['table']} ({figures['bytes']} bytes) after {figures['seconds']:.1f} s"


main = shell.main_of(parser, _compile)
