"""A certificate: how many squeezes any plan takes that is as good as this one."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.metric import metric_of
from planner.belief.observation import COUNTS, Encoder, encoder_of
from planner.belief.particles import initial
from planner.bound.histories import gather
from planner.bound.lagrangian import Term, leaves_term, overall_term
from planner.bound.placements import covered
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.work.progress import Report, silent
from runtime.table import PPM, Table, wilson_interval

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
            f"{self.confidence:.2%} of theirs or more; first two squeezes at placements of the job, those it "
            f"proposes{grid} and this plan's own ({self.first} for the first, {self.second:.0f} on average "
            "for the second), later ones anywhere"
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
            "terms": {"leaves": self.leaves.figures(), "overall": self.overall.figures()},
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


@dataclass(frozen=True, slots=True, eq=False)
class Squeezes:
    """The world that the evaluation judges plans in, as `planner.bound.histories.Model`."""

    simulator: Simulator
    encoder: Encoder

    def squeeze(
        self, poses: Array, placements: Array, times: int, rng: np.random.Generator
    ) -> tuple[Array, IntArray]:
        """As there."""
        parameters = self.simulator.sample(len(poses), rng)
        rolled = self.simulator.roll_out(to_hand(poses, placements.T), parameters)
        counts = self.encoder.read(np.tile(rolled.width_mm, (times, 1)), rng)
        return to_world(rolled.poses, placements.T), counts + COUNTS * (rolled.width_mm > 0.0)


def certify(
    job: Job, table: Table, parts: int = PARTS, dense: bool = False, workers: int | None = None,
    report: Report = silent,
) -> Certificate:  # fmt: skip
    """Proves a lower bound of the squeezes of plans that are as good as a table.

    Args:
        job: the table's.
        table: evaluated; its first two squeezes and its success say what is compared.
        parts: size of the sample; more prove more.
        dense: cover a grid of placements beside those of the job.
        workers: threads; all cores if None. The result does not depend on it.
        report: told about progress.
    """
    rng = np.random.default_rng([job.seed, SEED_BOUND])
    metric = metric_of(job)
    model = Squeezes(Simulator.of_job(job, workers), encoder_of(job))
    placements = covered(job, table, model, dense, np.random.default_rng([job.seed, SEED_PILOTS]))
    levels = gather(model, initial(job, parts, rng), metric, placements, DEPTH, rng, report)
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
