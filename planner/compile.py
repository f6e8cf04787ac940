"""From a job to a decision table: the whole planner on one screen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.belief import initial
from planner.encoder import encoder_of
from planner.errors import NoPlanError
from planner.evaluate import Evaluation, evaluate
from planner.goal import metric_of
from planner.job import Job
from planner.lower import lower, with_evaluation
from planner.mechanics.simulator import Simulator
from planner.part.outline import radius_of_gyration
from planner.search.actions import actions_of
from planner.search.closed_loop import LookAhead
from planner.search.expand import TreeNode, grow, learn, root_of
from planner.search.outcomes import MotionModel
from planner.world import ContactWorld
from runtime.table import Table, canonical

EVALUATION_TRIALS = 20_000
REFINEMENTS = 3
"""How often leaves that the evaluation finds short of the goal are expanded further."""
SEED_EVALUATION = 0x4556
SEED_WORLD = 0x574F

Report = Callable[[str, int, int], None]
"""Called with a stage's name, how much of it is done and how much there is."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A compiled job.

    Attributes:
        table: the decision table, canonical, with the evaluation's figures.
        root: the tree with its beliefs, for reports.
        evaluation: what the table was judged by.
    """

    table: Table
    root: TreeNode
    evaluation: Evaluation


def compile_job(
    job: Job, workers: int | None = None, trials: int = EVALUATION_TRIALS, report: Report | None = None
) -> Plan:
    """Plans, lowers the tree to a table, and evaluates the table.

    Args:
        job: the checked job.
        workers: threads; all cores if None. The result does not depend on it.
        trials: parts squeezed in the evaluation.
        report: told about progress.

    Raises:
        NoPlanError: the first squeeze already has no placement free of collision that gains anything, or no
            leaf of the tree is within the goal.
    """
    say = report or (lambda _stage, _done, _total: None)
    simulator = Simulator.of_job(job, workers)
    look_ahead = LookAhead(
        actions=actions_of(job),
        model=MotionModel(simulator, encoder_of(job)),
        metric=metric_of(job, radius_of_gyration(job.part.outline_mm)),
        confidence=job.goal.confidence,
        depth=job.search.depth,
        squeeze_cost=job.search.squeeze_cost,
        particles=job.search.search_particles,
    )
    root = root_of(initial(job, job.search.particles, np.random.default_rng([job.seed, 0])), look_ahead)
    for attempt in range(REFINEMENTS + 1):
        grow(
            root, look_ahead, job.search.max_depth, [job.seed, attempt], lambda a, b: say("search", a, a + b)
        )
        if not root.children:
            raise NoPlanError(
                f"{job.part.name}: no first squeeze is free of collision and gains anything; open the jaws "
                "wider, add actions, or reduce the uncertainty"
            )
        table = canonical(lower(root, job))
        say("evaluate", attempt, REFINEMENTS + 1)
        world = ContactWorld(job, job.seed + SEED_WORLD + attempt, workers)
        evaluation = evaluate(table, job, world, trials, job.seed + SEED_EVALUATION + attempt)
        beliefs = {k: evaluation.poses[evaluation.leaf == k] for k in range(len(table.leaves))}
        if attempt == REFINEMENTS or learn(root, beliefs, look_ahead) == 0:
            break
    table, evaluation = with_evaluation(table, evaluation, job)
    if not any(leaf.resolved for leaf in table.leaves):
        goal = f"{job.goal.distance_mm} mm at confidence {job.goal.confidence}"
        error = NoPlanError(f"{job.part.name}: no leaf comes within {goal}; add actions, or ask for less")
        error.success = float(np.mean(evaluation.error_mm < evaluation.goal_mm))
        raise error
    return Plan(table, root, evaluation)
