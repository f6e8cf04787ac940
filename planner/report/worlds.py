"""A table's figures: in the world that it was planned for, and in those where one assumption is broken.

Every command that tells figures of a plan tells these, so that they are the same everywhere.
"""

import time
from functools import partial

from planner.compile import SEED_FIGURES
from planner.evaluation.cases import Case, assumption_cases, believed_cases
from planner.evaluation.evaluate import Line, evaluate, sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

TRIALS = 2000  # in each world where an assumption is broken
LEAST_TRIALS = 100  # the same where time is short
TIMED_TRIALS = 200  # parts squeezed to estimate how long a world takes


def evaluation_of(
    table: Table, job: Job, trials: int, scheduler: Scheduler | None = None
) -> Evaluation:
    """The evaluation whose figures the compiler put into a table; of so many trials where it put none in."""
    seed = job.seed + SEED_FIGURES
    worlds = ContactWorlds.of_job(job, seed)
    return evaluate(table, job, worlds, table.predicted.trials or trials, seed, scheduler)


def tried(
    table: Table,
    job: Job,
    planned: Evaluation,
    trials: int = TRIALS,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> list[Line]:
    """A table in its own world, as `evaluation_of` has it, and in each where an assumption is broken.

    These are the assumptions that plans make, and what the job doubts at the ends of its intervals.
    """
    seed, (stated, *others) = job.seed + SEED_FIGURES, _cases(job)
    worlds = partial(ContactWorlds.of_job, seed=seed)
    return [
        Line(stated, planned),
        *sweep(table, job, others, worlds, trials, seed, scheduler, report),
    ]


def seconds_a_part(table: Table, job: Job, scheduler: Scheduler | None = None) -> float:
    """Seconds that it takes to evaluate a part, of a short trial."""
    began = time.monotonic()
    evaluate(table, job, ContactWorlds.of_job(job, job.seed), TIMED_TRIALS, job.seed, scheduler)
    return (time.monotonic() - began) / TIMED_TRIALS


def affordable(job: Job, seconds: float, part_s: float) -> int:
    """Trials for `tried` to take about so many seconds: at most `TRIALS`, at least `LEAST_TRIALS`.

    Args:
        job: which other worlds there are.
        seconds: to spend.
        part_s: as `seconds_a_part` tells.
    """
    return min(TRIALS, max(LEAST_TRIALS, int(seconds / (len(_cases(job)) * part_s))))


def _cases(job: Job) -> list[Case]:
    """The job's own world first."""
    return list(
        {case.name: case for case in (*assumption_cases(job), *believed_cases(job))}.values()
    )
