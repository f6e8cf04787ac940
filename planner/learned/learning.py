"""Which jobs are planned with a learned motion model, and how it comes about."""

from __future__ import annotations

from planner.belief.encoder import encoder_of
from planner.job import Job
from planner.learned.model import LearnedModel
from planner.learned.region import region_radius
from planner.learned.rollouts import RollOuts, roll_outs, slopes
from planner.learned.store import Store
from planner.mechanics.simulator import Simulator
from planner.progress import Report, silent
from planner.scheduler import Scheduler, Threads


def learns(job: Job) -> bool:
    """Whether a job's look-ahead uses a learned model: where it says so.

    "auto" is the simulator: learning once costs about as much as it saves, and the plans are no better
    (decision 0011). Nor may what the cache happens to hold decide: it would change the table's bytes.
    """
    return job.search.model == "kcde"


def learned_model(
    job: Job,
    simulator: Simulator,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> tuple[LearnedModel, RollOuts]:
    """The model learned from the roll-outs of a job, and the roll-outs.

    Args:
        job: the checked job.
        simulator: its squeezes.
        store: where roll-outs are kept; nowhere if None.
        scheduler: who rolls them out; as many threads as the simulator has if None.
        report: told about progress.

    Raises:
        ClusterError: the cluster was lost.
    """
    threads = scheduler or Threads(simulator.workers)
    order = (simulator, region_radius(job), job.search.rollouts, store, threads, report)
    rolled, slope = roll_outs(*order), slopes(*order)
    return LearnedModel.fit(simulator, encoder_of(job), job.part.symmetry, rolled, slope), rolled
