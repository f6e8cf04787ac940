"""Figures of a table in its planned world, and in worlds that break one assumption each.

All commands that judge a table take their figures from here, so that the figures agree.
"""

import time

from planner.compile import SEED_FIGURES
from planner.evaluation.cases import Case, assumption_cases, believed_cases
from planner.evaluation.evaluate import Line, evaluate, sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

TRIALS = 2000  # trials in each world where an assumption is broken
LEAST_TRIALS = 100  # least number of these trials where time is short
TIMED_TRIALS = 200  # parts squeezed to estimate the duration of a world


def evaluation_of(table: Table, job: Job, trials: int) -> Evaluation:
    """Repeats the evaluation whose figures a table stores; evaluates `trials` parts if it stores none."""
    seed = job.seed + SEED_FIGURES
    worlds = ContactWorlds.of_job(job, seed)
    return evaluate(table, job, worlds, table.predicted.trials or trials, seed)


def tried(
    table: Table,
    job: Job,
    planned: Evaluation,
    trials: int = TRIALS,
    scheduler: Scheduler | None = None,
    report: Report = silent,
    limit: Limit | None = None,
) -> list[Line]:
    """Evaluates a table in worlds other than its planned one.

    Each further world breaks one assumption of plans, or sets one uncertain quantity of the job to an end of
    its interval.

    Args:
        table: the table.
        job: the job of the table.
        planned: the evaluation in the planned world, from `evaluation_of`.
        trials: number of parts in each further world.
        scheduler: runs the trials; None: threads on all cores.
        report: receives the progress.
        limit: once it is over, no further world is tried.

    Returns:
        A line for the planned world, then one for each further world.
    """
    seed, (stated, *others) = job.seed + SEED_FIGURES, _cases(job)
    lines = [Line(stated, planned)]
    for line in sweep(table, job, others, trials, seed, scheduler, report):
        lines.append(line)
        if limit is not None and limit.over():
            break
    return lines


def seconds_a_part(table: Table, job: Job, scheduler: Scheduler) -> float:
    """Seconds that the evaluation of one part takes, measured with `TIMED_TRIALS` parts."""
    began = time.monotonic()
    evaluate(table, job, ContactWorlds.of_job(job, job.seed), TIMED_TRIALS, job.seed, scheduler)
    return (time.monotonic() - began) / TIMED_TRIALS


def affordable(job: Job, seconds: float, part_s: float) -> int:
    """Number of trials in each world for which the time suffices, from `LEAST_TRIALS` to `TRIALS`.

    Args:
        job: the job; the worlds follow from it.
        seconds: the time for all worlds.
        part_s: seconds for one part, from `seconds_a_part`.
    """
    return min(TRIALS, max(LEAST_TRIALS, int(seconds / (len(_cases(job)) * part_s))))


def untried(job: Job, lines: list[Line]) -> list[str]:
    """Names of the worlds that `tried` left out."""
    return [case.name for case in _cases(job)[len(lines) :]]


def _cases(job: Job) -> list[Case]:
    """The worlds that `tried` evaluates, the planned one first."""
    cases = (*assumption_cases(job), *believed_cases(job))
    return list({case.name: case for case in cases}.values())
