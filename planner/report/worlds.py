"""A table's figures: in the world that it was planned for, and in those where one assumption is broken.

Every command that tells figures of a plan tells these, so that they are the same everywhere.
"""

from functools import partial

from planner.compile import SEED_FIGURES
from planner.evaluation.cases import assumption_cases, believed_cases
from planner.evaluation.evaluate import Line, evaluate, sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

TRIALS = 2000  # in each world where an assumption is broken


def evaluation_of(table: Table, job: Job, trials: int, scheduler: Scheduler | None = None) -> Evaluation:
    """The evaluation whose figures the compiler put into a table; of so many trials where it put none in."""
    seed = job.seed + SEED_FIGURES
    worlds = ContactWorlds.of_job(job, seed)
    return evaluate(table, job, worlds, table.predicted.trials or trials, seed, scheduler)


def tried(
    table: Table, job: Job, planned: Evaluation, trials: int = TRIALS, scheduler: Scheduler | None = None,
    report: Report = silent,
) -> list[Line]:  # fmt: skip
    """A table in its own world, as `evaluation_of` has it, and in each where an assumption is broken.

    These are the assumptions that plans make, and what the job doubts at the ends of its intervals.
    """
    seed = job.seed + SEED_FIGURES
    own, *assumed = assumption_cases(job)
    cases = {case.name: case for case in (*assumed, *believed_cases(job))}
    worlds = partial(ContactWorlds.of_job, seed=seed)
    others = sweep(table, job, list(cases.values()), worlds, trials, seed, scheduler, report)
    return [Line(own, planned), *others]
