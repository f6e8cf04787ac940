"""Baseline: Goldberg's sensorless squeeze plan, evaluated in the same world as decision tables."""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.metric import metric_of
from planner.belief.particles import initial
from planner.evaluation.evaluate import Chunk, chunks_of
from planner.frames import to_hand, to_world, wrap
from planner.job.cell import timing_of
from planner.job.model import Job
from planner.paper.sensorless import SqueezePlan, plan
from planner.part.outline import convex_hull
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorld, ContactWorlds
from runtime.table import REJECT, Node, Schedule, Squeeze, Squeezed, placement

ORIENTED_DEG = 5.0  # A part counts as oriented within this (the paper's tolerance, VII)
NO_FRICTION = {"finger_part_min": 0.0, "finger_part_max": 0.0}
IDEAL = {"friction": NO_FRICTION, "gripper": {"finger_length_mm": 900.0}}
SEED_BASELINE = 0x42415345
WIDTH_DIGITS = 1  # decimals of widths [mm]: parts whose widths agree to these take equally long


class Achieved(NamedTuple):
    """Results of a sensorless plan in one world."""

    oriented: float  # share within `ORIENTED_DEG` of the predicted angle, modulo the period
    located: float  # share within the job's goal of the best pose or poses
    located_modulo: float  # the same, with angles modulo the plan's period
    seconds: float  # mean time a part, by the table's model of time


class Baseline(NamedTuple):
    """The sensorless plan of a job, and its results."""

    plan: SqueezePlan  # the squeezes
    bound: int  # upper bound on the squeezes of such a plan: 2 n - 1 for a hull of n vertices
    real: Achieved  # results in the job's stochastic contact world
    ideal: Achieved  # results with long jaws and no friction: only the order of contacts matters
    trials: int  # number of parts in each of the two worlds

    def figures(self) -> dict[str, Any]:
        """The plan and its results as JSON types."""
        return {
            "baseline": "sensorless",
            "angles_deg": [round(float(angle), 6) for angle in np.degrees(self.plan.angles)],
            "squeezes": len(self.plan.angles),
            "most_squeezes": self.bound,
            "final_deg": float(np.degrees(self.plan.final)),
            "period_deg": float(np.degrees(self.plan.period)),
            "slack_deg": float(np.degrees(self.plan.slack)),
            "trials": self.trials,
            "real": self.real._asdict(),
            "ideal": self.ideal._asdict(),
        }


def sensorless(job: Job, trials: int, scheduler: Scheduler | None = None) -> Baseline:
    """Plans a job without sensors, and runs the plan on `trials` parts in each of two worlds.

    One is the job's world, the other has long jaws and no friction. The hand is always placed at the origin.
    The result does not depend on the scheduler; None uses all cores.
    """
    squeezes = plan(job.part.outline_mm)
    ideal = job.replaced("the job without friction", **IDEAL)
    scheduler = scheduler or Threads()
    real, without = (_achieved(true, squeezes, trials, scheduler) for true in (job, ideal))
    bound = 2 * len(convex_hull(job.part.outline_mm)) - 1
    return Baseline(squeezes, bound, real, without, trials)


def text(part: str, baseline: Baseline) -> str:
    """The plan and its results as text."""
    squeezes, real, ideal = baseline.plan, baseline.real, baseline.ideal
    angles = ", ".join(f"{angle:.1f}" for angle in np.degrees(squeezes.angles))
    period, final, slack = np.degrees([squeezes.period, squeezes.final, squeezes.slack])
    return f"""\
{part}: {len(squeezes.angles)} squeeze{"s" * (len(squeezes.angles) > 1)} without sensors \
(Goldberg 1993; at most {baseline.bound})
hand at the origin, at {angles} deg
in theory  every part ends at {final % period:.1f} deg modulo {period:.0f} deg; the squeezes leave \
{slack:.1f} deg to spare
no friction, long jaws   oriented {ideal.oriented:7.2%}  located {ideal.located_modulo:7.2%}  \
whole pose {ideal.located:7.2%}
this gripper             oriented {real.oriented:7.2%}  located {real.located_modulo:7.2%}  \
whole pose {real.located:7.2%}
of {baseline.trials} parts each; oriented: within {ORIENTED_DEG:.0f} deg; located: within the goal, both \
modulo {period:.0f} deg; about {real.seconds:.1f} s a part"""


def _squeezed(job: Job, worlds: ContactWorlds, angles: Array, chunk: Chunk) -> tuple[Array, Array]:
    """Squeezes the n parts of a chunk with the hand at the origin, at each of `angles` in turn.

    Returns:
        Final poses (n, 3) in the world [mm, mm, rad], and widths (n, squeezes) [mm].
    """
    rng = np.random.default_rng([job.seed, chunk.number, SEED_BASELINE])
    world = ContactWorld.of_simulator(worlds.simulators[0], [worlds.seed, chunk.number])
    poses, widths = initial(job, chunk.trials, rng), np.empty((chunk.trials, len(angles)))
    for k, angle in enumerate(angles):
        hand = np.array([0.0, 0.0, angle])
        rolled = world.squeeze_many(to_hand(poses, hand))
        poses = to_world(rolled.poses, hand)
        widths[:, k] = rolled.width_mm
    return poses, widths


def seconds_of(job: Job, angles: Array, widths: Array) -> float:
    """Mean seconds that a part takes, by the model of time, if squeezes end at widths (n, squeezes) [mm]."""
    gripper = job.gripper
    opening_um, speed_um_s = round(1e3 * gripper.opening_mm), round(1e3 * gripper.speed_mm_s)
    alike = gripper.upper_finger_share == 0.5
    turns = np.unwrap(angles, period=math.pi if alike else math.tau)
    urads = (round(1e6 * float(angle)) for angle in turns)
    nodes = [Node(Squeeze(0, 0, urad, opening_um, speed_um_s, 0, 0), ()) for urad in urads]
    schedule = Schedule(nodes, timing_of(job))
    before = placement(nodes[-1].squeeze)
    rows, parts = np.unique(widths.round(WIDTH_DIGITS), axis=0, return_counts=True)
    taken = []
    for row in rows.tolist():
        squeezed = [Squeezed(k, width, REJECT) for k, width in enumerate(row)]
        taken.append(sum(phases.total_s for phases in schedule.part(squeezed, before)))
    return float(np.average(taken, weights=parts))


def _achieved(job: Job, squeezes: SqueezePlan, trials: int, scheduler: Scheduler) -> Achieved:
    """Runs a plan on `trials` parts in the contact world of a job."""
    worlds = ContactWorlds.of_job(job, job.seed + SEED_BASELINE)
    run = partial(_squeezed, job, worlds, squeezes.angles)
    parts = list(scheduler.map(run, chunks_of(trials)))
    poses, widths = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    metric = metric_of(job)
    orders = round(2.0 * np.pi / squeezes.period)
    off = np.abs(wrap(poses[:, 2] - squeezes.final, orders))
    return Achieved(
        oriented=float(np.mean(off < np.radians(ORIENTED_DEG))),
        located=metric.mode(poses).ratio,
        located_modulo=metric._replace(order=orders).mode(poses).ratio,
        seconds=seconds_of(job, squeezes.angles, widths),
    )
