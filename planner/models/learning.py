"""Which jobs are planned with a learned motion model, and how it comes about."""

from __future__ import annotations

from planner.encoder import encoder_of
from planner.job import Job
from planner.mechanics.simulator import Simulator
from planner.models.learned import LearnedModel
from planner.models.region import region_radius
from planner.models.rollouts import RollOuts, roll_outs, slopes
from planner.models.store import Store
from planner.progress import Report, silent
from planner.scheduler import Scheduler, Threads
from planner.search.actions import actions_of

SQUEEZES_SAVED = 160
"""Squeezes that learning saves in a tree's look-ahead, for each particle and placement to choose from."""
SQUEEZES_SPENT = 8
"""Squeezes' worth of time that learning takes for each roll-out: with slopes, bandwidths, sorting."""
WORTH = 4.0
"""How often learning must pay for itself: plans made with it may need some more squeezes (decision 0011)."""


def learns(job: Job) -> bool:
    """Whether a job's look-ahead uses a learned model: it says so, or "auto" expects to save much time.

    Both what is saved and what is spent are squeezes of the same part, so the machine's speed does not
    matter; and what the cache happens to hold must not, for it would change the table's bytes.
    """
    if job.search.model != "auto":
        return job.search.model == "kcde"
    actions = actions_of(job)
    proposed = 0 if actions.proposals is None else len(actions.proposals.relative)
    choices = (len(actions) + proposed) * job.search.search_particles
    return SQUEEZES_SAVED * choices > WORTH * SQUEEZES_SPENT * job.search.rollouts


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
