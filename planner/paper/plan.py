"""Plans a job by the paper's method: roll-outs, learned models, and Algorithm 1."""

from functools import partial

import numpy as np

from planner.belief.observation import encoder_of
from planner.belief.particles import initial
from planner.job.model import Job
from planner.learned.rollouts import PAPER_COUNT, region_radius, roll_outs
from planner.mechanics.clearance import least_clearance
from planner.mechanics.simulator import Simulator
from planner.paper.search import PaperPlanner, learn, search_depth
from planner.part.outline import radius_of_gyration
from planner.search.actions import actions_of
from planner.search.tree import Node
from planner.work.progress import Report, silent


def plan_paper(job: Job, simulator: Simulator, report: Report = silent) -> Node:
    """Plans a job with method "paper" or "sensorless"; returns the root of the tree.

    The constants are the paper's. The job's [search] gives only the method, the particles and the longest
    path, and its [actions] the angles and centres. The tree has one node if each first squeeze collides or
    lowers the singleton ratio too much.
    """
    rolled = roll_outs(simulator, region_radius(job), PAPER_COUNT, report)
    encoder, rho_mm = encoder_of(job), radius_of_gyration(job.part.outline_mm)
    placements = actions_of(job).placements
    planner = PaperPlanner(
        placements=placements,
        models=learn(rolled, simulator, encoder, rho_mm, job.part.symmetry),
        encoder=encoder,
        clearance=partial(least_clearance, simulator.outline, simulator.jaws),
        method=job.search.method,
        depth=search_depth(len(placements)),
        max_depth=job.search.max_depth,
        order=job.part.symmetry,
    )
    belief = initial(job, job.search.particles, np.random.default_rng([job.seed, 0]))
    return planner.plan(belief, [job.seed], report)
