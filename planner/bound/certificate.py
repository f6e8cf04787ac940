"""Certificate of a plan: a lower bound on the mean squeezes of all plans that are at least as good.

The bound holds for plans whose first `DEPTH` squeezes are at placements of three kinds: placements of the
job, placements at which the jaws close along stable sides of the part, and placements of the certified plan.
A plan that squeezes at other placements may need fewer squeezes.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, IntArray
from planner.belief.doubts import believed
from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of
from planner.belief.particles import Belief, subsample
from planner.belief.transition import read_as, true_placements
from planner.bound.histories import Depths, Histories, History, Squeeze
from planner.bound.lagrangian import Term, leaves_term, overall_term, worth_trying
from planner.evaluation.trials import encoder_of_table, placement_of
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.search.actions import actions_of, inequivalent
from planner.search.proposals import along
from planner.work.progress import Report, silent
from runtime.table import PPM, REJECT, Table, decide, decision_map, wilson_interval

PILOTS = 20_000  # parts of the separate sample, whose modes give the placements along stable sides
BELIEF = 400  # most parts of a history from which modes are computed
DENSE_ANGLES_DEG = np.arange(0.0, 180.0, 15.0)
DENSE_SHIFTS = (-0.5, 0.0, 0.5)  # shifts along the fingers, in lengths of the finger

PARTS = 50_000
MOST_PARTS = 1_000_000
TRIED = 2  # length up to which all histories are extended [squeezes]
DEPTH = 3  # length up to which the histories of the cheapest plans are extended [squeezes]
ROUNDS = 8  # most rounds of extending histories from `TRIED` to `DEPTH` squeezes
LEAST_PARTS = 20  # least parts of a history that such a round extends
CERTAINTY = 0.95  # probability with which a bound holds
SEED_BOUND = 0x424F554E
SEED_PILOTS = 0x50494C4F


class Covered:
    """Gives the placements that a class of plans may use after a history of squeezes.

    Call an instance with a history, as described at `planner.bound.histories.Placements`. The placements
    along stable sides are computed from a separate sample of parts, since the class of plans may not depend
    on the sample that proves the bound.

    Attributes:
        first: (k, 3) placements of the first squeeze: the table's, then all others that are not equivalent to
            an earlier one.
    """

    def __init__(self, job: Job, table: Table, squeeze: Squeeze, dense: bool) -> None:
        """Collects the placements of a job and of its table and, if `dense`, a grid about the world's origin.

        The grid has all pairs of an angle and a shift of the hand along its fingers.
        """
        self._actions, self._metric, self._squeeze = actions_of(job), metric_of(job), squeeze
        self._more, self._seed = np.zeros((0, 3)), [job.seed, SEED_PILOTS]
        if dense:  # every 15 degrees, in the middle and on either side of it
            middle = np.array([[0.0, 0.0, math.radians(angle)] for angle in DENSE_ANGLES_DEG])
            shifts = [share * job.gripper.finger_length_mm for share in DENSE_SHIFTS]
            self._more = np.concatenate([along(middle, shift) for shift in shifts])
        common = np.concatenate([self._actions.placements, self._more])
        root = placement_of(table.nodes[0].squeeze)[None]
        self.first = inequivalent(np.concatenate([root, common]), common, job)
        self._nodes, self._encoder = table.nodes, encoder_of_table(table)
        self._maps = cache(lambda node: decision_map(table.nodes[node], table.gripper))
        self._all = believed(job, PILOTS, np.random.default_rng(self._seed))
        # Keyed by history and the number of the next placement.
        self._squeezed = dict[History, Belief]()

    def __call__(self, history: History) -> Array:
        """The placements (k, 3) that plans may choose for the squeeze after a history.

        For an empty history these are `first`. For any other history, if the table squeezes again after it,
        the placement of that squeeze comes last.
        """
        if not history:
            return self.first
        pilots, node = self._after(history), self._node(history)
        options = [self._actions.placements]
        if len(pilots):
            options += self._actions.along_sides(subsample(pilots, BELIEF).states, self._metric)
        planned = [placement_of(self._nodes[node].squeeze)[None]] if node >= 0 else []
        return np.concatenate([self._actions.within(np.concatenate(options)), self._more, *planned])

    def _after(self, history: History) -> Belief:
        """The parts of the separate sample that have this history; there may be none."""
        if not history:
            return self._all
        *before, option, reading = history
        squeezed = (*before, option)
        if squeezed not in self._squeezed:
            parts, placement = self._after(tuple(before)), self(tuple(before))[option]
            rng = np.random.default_rng([*self._seed, *squeezed])
            after, seen = self._squeeze(parts, np.tile(placement, (len(parts), 1)), rng)
            self._squeezed[squeezed] = Belief(after, parts.traits, seen)
        parts = self._squeezed[squeezed]
        return parts[parts.reading == reading]

    def _node(self, history: History) -> int:
        """Index of the node that the table reaches after a history; negative if there is none.

        There is none if the history squeezes at another grasp pose than the table does, or if the table ends
        before the history does, at a leaf or with REJECT.
        """
        if not history:
            return 0
        *before, option, reading = history
        node, placement = self._node(tuple(before)), self(tuple(before))[option]
        if node < 0 or not np.array_equal(placement, placement_of(self._nodes[node].squeeze)):
            return -1
        width_um = int(self._encoder.width_um(np.asarray(reading >> 1)))
        branch = decide(self._maps(node), width_um, bool(reading & 1))
        return -1 if branch == REJECT else self._nodes[node].branches[branch].target


@dataclass(frozen=True, slots=True)
class Certificate:
    """A proven lower bound on the mean squeezes of all plans that are as good as a table."""

    leaves: Term  # bound for plans whose leaves hold the job's confidence
    overall: Term  # bound for plans that locate the share `success` of all parts
    confidence: float  # share of right answers that the job requires of a leaf
    success: float  # lower limit of the table's success rate in its trials, with 97.5 % confidence
    mean: float  # mean squeezes a part in the trials of the table
    parts: int  # parts of the sample that proves the bound
    first: int  # number of inequivalent placements of the first squeeze
    second: float  # number of placements of the second squeeze, averaged over the histories of one squeeze
    dense: bool  # whether the placements include a grid

    @property
    def squeezes(self) -> float:
        """The greater of the bounds `leaves` and `overall`, for plans that belong to both classes."""
        return max(self.leaves.squeezes, self.overall.squeezes)

    @property
    def rounded(self) -> str:
        """The bound with two decimals, rounded down so that it remains proven."""
        return f"{math.floor(100.0 * self.squeezes) / 100.0:.2f}"

    @property
    def plans(self) -> str:
        """Describes in words the class of plans that the bound holds for."""
        grid = ", a dense grid" if self.dense else ""
        return (
            f"at least {self.success:.3%} of the parts located, at leaves that are right for "
            f"{self.confidence:.2%} of theirs or more; first three squeezes at placements of the job, "
            f"those along stable sides{grid} and this plan's own ({self.first} for the first, "
            f"{self.second:.0f} on average for the second), later ones anywhere"
        )

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
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
        """The bound and the class of plans, as lines of text for people."""
        above = self.mean / self.squeezes - 1.0
        least = f"any plan as good takes {self.rounded} squeezes a part or more"
        sure = f"({CERTAINTY:.0%} confidence, {self.parts} parts)"
        more = f"this one takes {above:.1%} more than that"
        return [f"{least} {sure}; {more}", f"as good: {self.plans}"]


def squeezes_of(job: Job, workers: int | None = None) -> Squeeze:
    """Returns a function that squeezes the parts of a belief once, with the latent parameters of each part.

    The function draws friction, limit surface and noise of the reading at random, by the same models as the
    world of the evaluation.
    """
    simulator, encoder = Simulator.of_job(job, workers), encoder_of(job)

    def squeeze(parts: Belief, placements: Array, rng: Generator) -> tuple[Array, IntArray]:
        hand = true_placements(placements, parts.traits, rng)
        rolled = simulator.squeeze(to_hand(parts.poses, hand.T), rng, parts.traits)
        readings = encoder.read(read_as(rolled.width_mm, parts.traits), rng)
        return to_world(rolled.poses, hand.T), 2 * readings + (rolled.width_mm > 0.0)

    return squeeze


def certify(
    job: Job,
    table: Table,
    parts: int = PARTS,
    dense: bool = False,
    workers: int | None = None,
    report: Report = silent,
) -> Certificate:
    """Proves a lower bound on the mean squeezes of all plans that are as good as a table.

    The bound holds with probability `CERTAINTY`. A plan is as good if it locates at least as large a share of
    parts as the table, and each leaf that states a pose is right as often as the job's goal asks. The table's
    share is the lower limit from its trials. The first `DEPTH` squeezes of the plan must be at the placements
    that the module's docstring describes.

    Args:
        job: the job.
        table: a table of the job, with the figures of its trials.
        parts: size of the sample; more parts give a tighter bound.
        dense: whether plans may also use a grid of placements about the world's origin.
        workers: threads, all cores if None; the result does not depend on it.
        report: receives the progress.
    """
    rng = np.random.default_rng([job.seed, SEED_BOUND])
    squeeze = squeezes_of(job, workers)
    placements = Covered(job, table, squeeze, dense)
    sample = believed(job, parts, rng)
    result = Histories(
        squeeze, sample, metric_of(job), placements, Depths(TRIED, DEPTH), rng, workers, report
    )
    predicted = table.predicted
    successes = round(predicted.success_ppm / PPM * predicted.trials)
    success, confidence = wilson_interval(successes, predicted.trials)[0], job.goal.confidence
    for left in range(ROUNDS, -1, -1):
        leaves = leaves_term(result.levels, confidence, success, CERTAINTY)
        overall = overall_term(result.levels, success, CERTAINTY)
        of_leaves = worth_trying(result.levels, TRIED, leaves.price, confidence)
        of_all = worth_trying(result.levels, TRIED, overall.price, 1.0)
        chosen = np.union1d(of_leaves, of_all)
        chosen = chosen[result.levels[TRIED].size[chosen] >= LEAST_PARTS]
        if not (left and len(chosen)):
            break
        result.extend(TRIED, chosen)
    return Certificate(
        leaves=leaves,
        overall=overall,
        confidence=confidence,
        success=success,
        mean=predicted.mean_squeezes_ppm / PPM,
        parts=parts,
        first=len(placements.first),
        second=len(result.levels[TRIED].owner) / len(result.levels[TRIED - 1].size),
        dense=dense,
    )
