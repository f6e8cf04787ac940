"""A certificate: how many squeezes any plan takes that is as good as this one.

It covers the job's placements, those along stable sides and the plan's own; not hands scattered about.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.metric import metric_of
from planner.belief.observation import COUNTS, encoder_of
from planner.belief.particles import initial, subsample
from planner.bound.histories import Squeeze, gather
from planner.bound.lagrangian import Term, leaves_term, overall_term
from planner.evaluation.trials import placement_of
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.search.actions import actions_of, inequivalent
from planner.search.proposals import along
from planner.work.progress import Report, silent
from runtime.table import PPM, REJECT, Calibration, Table, decision_map, wilson_interval

PILOTS = 10_000  # parts that show what may be read after the first squeeze
BELIEF = 400  # parts of a history that its modes are sought among
DENSE_ANGLES_DEG = np.arange(0.0, 180.0, 15.0)
DENSE_SHIFTS = (-0.5, 0.0, 0.5)  # shifts along the fingers, in lengths of the finger


@dataclass(frozen=True, slots=True, eq=False)
class Covered:
    """The placements of a class of plans; called as `planner.bound.histories.Placements`."""

    first: Array  # (k, 3) those of the first squeeze: the plan's own at the start, none equivalent to another
    second: list[dict[int, Array]]  # for each of these, those (m, 3) of the second squeeze by what was read
    common: Array  # (m, 3) those after a reading that is not among them

    def __call__(self, squeezes: int, option: int, reading: int) -> Array:
        """The placements (k, 3) of the next squeeze."""
        return self.second[option].get(reading, self.common) if squeezes else self.first


def covered(job: Job, table: Table, squeeze: Squeeze, dense: bool, rng: np.random.Generator) -> Covered:
    """The placements for a table's job: with a grid about the middle if `dense`, and the table's first two.

    Those proposed about modes are found with parts of their own, of `rng`: a certificate must not choose what
    it covers by the sample that it judges with.
    """
    actions, metric = actions_of(job), metric_of(job)
    parts, more = initial(job, PILOTS, rng), np.zeros((0, 3))
    if dense:  # every 15 degrees, over the middle and to either side of it
        middle = np.array([[0.0, 0.0, math.radians(angle)] for angle in DENSE_ANGLES_DEG])
        shifts = [share * job.gripper.finger_length_mm for share in DENSE_SHIFTS]
        more = np.concatenate([along(middle, shift) for shift in shifts])
    common = np.concatenate([actions.placements, more])
    root = placement_of(table.nodes[0].squeeze)[None]
    first = inequivalent(np.concatenate([root, common]), common, job)
    second: list[dict[int, Array]] = []
    for placement in first:
        after, readings = squeeze(parts, np.tile(placement, (len(parts), 1)), 1, rng)
        about: dict[int, Array] = {}
        for reading in np.unique(readings):
            belief = subsample(after[readings[0] == reading], BELIEF)
            about[int(reading)] = np.concatenate([actions.options(belief, metric), more])
        second.append(about)
    for reading, branch in enumerate(decision_map(table.nodes[0], Calibration.linear(table.gripper))):
        if branch != REJECT and (target := table.nodes[0].branches[branch].target) >= 0:
            own = placement_of(table.nodes[target].squeeze)[None]
            second[0][reading] = np.concatenate([second[0].get(reading, common), own])
    return Covered(first, second, common)


PARTS = 50_000
MOST_PARTS = 1_000_000
DEPTH = 2
CERTAINTY = 0.95
SEED_BOUND = 0x424F554E
SEED_PILOTS = 0x50494C4F


@dataclass(frozen=True, slots=True)
class Certificate:
    """What is proved about the plans that may be compared with a table's."""

    leaves: Term  # the bound for plans whose leaves hold the job's confidence
    overall: Term  # the bound for plans that locate the share `success` of all parts
    confidence: float  # the job's, of a leaf
    success: float  # what the table's own trials showed at least, with 97.5 % confidence
    mean: float  # squeezes a part of the table
    parts: int  # size of the sample
    first: int  # inequivalent placements of the first squeeze
    second: float  # placements of the second squeeze, on average over what was read
    dense: bool  # whether a grid of placements is among them

    @property
    def squeezes(self) -> float:
        """The bound for plans of both classes."""
        return max(self.leaves.squeezes, self.overall.squeezes)

    @property
    def rounded(self) -> str:
        """The bound with two digits, rounded down: what is shown is proved."""
        return f"{math.floor(100.0 * self.squeezes) / 100.0:.2f}"

    @property
    def plans(self) -> str:
        """Which plans it holds for."""
        grid = ", a dense grid" if self.dense else ""
        return (
            f"at least {self.success:.3%} of the parts located, at leaves that are right for "
            f"{self.confidence:.2%} of theirs or more; first two squeezes at placements of the job, "
            f"those along stable sides{grid} and this plan's own ({self.first} for the first, "
            f"{self.second:.0f} on average for the second), later ones anywhere"
        )

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "squeezes": self.squeezes,
            "confidence": CERTAINTY,
            "plans": self.plans,
            "success_rate": self.success,
            "leaf_confidence": self.confidence,
            "above_bound": self.mean / self.squeezes - 1.0,
            "parts": self.parts,
            "depth": DEPTH,
            "terms": {"leaves": self.leaves._asdict(), "overall": self.overall._asdict()},
        }

    def lines(self) -> list[str]:
        """For people."""
        above = self.mean / self.squeezes - 1.0
        least = f"any plan as good takes {self.rounded} squeezes a part or more"
        sure = f"({CERTAINTY:.0%} confidence, {self.parts} parts)"
        return [
            f"{least} {sure}; this one takes {above:.1%} more than that",
            f"as good: {self.plans}",
        ]


def squeezes_of(job: Job, workers: int | None = None) -> Squeeze:
    """Squeezes in the world that the evaluation judges plans in."""
    simulator, encoder = Simulator.of_job(job, workers), encoder_of(job)

    def squeeze(
        poses: Array, placements: Array, times: int, rng: np.random.Generator
    ) -> tuple[Array, IntArray]:
        rolled = simulator.roll_out(to_hand(poses, placements.T), simulator.sample(len(poses), rng))
        counts = encoder.read(np.tile(rolled.width_mm, (times, 1)), rng)
        return to_world(rolled.poses, placements.T), counts + COUNTS * (rolled.width_mm > 0.0)

    return squeeze


def certify(
    job: Job, table: Table, parts: int = PARTS, dense: bool = False, workers: int | None = None,
    report: Report = silent,
) -> Certificate:  # fmt: skip
    """Proves a lower bound of the squeezes of plans that are as good as the evaluated table of a job.

    Its first two squeezes and its success say what is compared. `parts` is the size of the sample, of which
    more prove more; `dense` covers a grid of placements beside those of the job. The result does not depend
    on the number of workers (threads), all cores if None.
    """
    rng = np.random.default_rng([job.seed, SEED_BOUND])
    metric = metric_of(job)
    squeeze = squeezes_of(job, workers)
    placements = covered(job, table, squeeze, dense, np.random.default_rng([job.seed, SEED_PILOTS]))
    levels = gather(squeeze, initial(job, parts, rng), metric, placements, DEPTH, rng, report)
    predicted = table.predicted
    successes = round(predicted.success_ppm / PPM * predicted.trials)
    success = wilson_interval(successes, predicted.trials)[0]
    return Certificate(
        leaves=leaves_term(levels, job.goal.confidence, success, CERTAINTY),
        overall=overall_term(levels, success, CERTAINTY),
        confidence=job.goal.confidence,
        success=success,
        mean=predicted.mean_squeezes_ppm / PPM,
        parts=parts,
        first=len(placements.first),
        second=float(np.mean([len(options) for about in placements.second for options in about.values()])),
        dense=dense,
    )
