"""Finds the poses that a plan leaves open, and squeezes that would distinguish them."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from planner.arrays import Array
from planner.belief.metric import Metric
from planner.belief.observation import encoder_of
from planner.evaluation.judge import main_poses, metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.frames import to_hand, wrap
from planner.job.model import Job
from planner.mechanics.clearance import least_clearance
from planner.mechanics.simulator import Simulator
from planner.part.outline import reach
from planner.search.actions import actions_of
from planner.search.proposals import hands_about, placed
from runtime.table import HELD_UM, Table

HANDS = 128  # placements tried to distinguish two poses
SAMPLES = 40  # squeezes of each pose at each placement tried
HALF_TURN_ALIKE = 2  # order of the hand's symmetry: after half a turn it squeezes alike
TELLING = 4.0  # least distance of distinguishable mean widths, in joint standard deviations
LEAST_TRIALS = 20  # least parts in a leaf that is examined
APART = 3.0  # distance from a pose, in units of the goal, above which parts lie at another pose
SEED_AMBIGUITY = 0x414D4249


class Separator(NamedTuple):
    """A squeeze whose width distinguishes two poses."""

    placement: Array  # (3,) the hand in the world [mm, mm, rad]
    widths_mm: tuple[float, float]  # mean widths at the first pose and at the second


class Whereabouts(NamedTuple):
    """The main poses of the parts that end in a leaf, or their scatter about a single pose."""

    poses: Array  # (m, 3) main poses, the most frequent first [mm, mm, rad]
    shares: tuple[float, ...]  # (m,) share of the parts within the goal of each pose
    scatter: float = 0.0  # largest distance from a single pose, in goals; 0 if there are several

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        return {
            "poses": np.round(self.poses, 5).tolist(),
            "shares": [round(share, 4) for share in self.shares],
            "scatter": round(self.scatter, 3),
        }

    def text(self) -> str:
        """States the poses and their shares, for people."""
        pairs = zip(self.shares, self.poses, strict=True)
        return " or ".join(f"{pose_text(pose)} ({share:.1%})" for share, pose in pairs)


class Ambiguity(NamedTuple):
    """An unresolved leaf: the main poses of its parts, and a squeeze that distinguishes two of them."""

    leaf: int  # index of the leaf
    share: float  # share of all parts that end at the leaf
    where: Whereabouts  # the main poses of these parts
    separator: Separator | None  # distinguishes the first two poses; None: no squeeze tried does

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        record = {"leaf": self.leaf, "share": self.share, **self.where.figures(), "separator": None}
        if self.separator is not None:
            placement, widths_mm = self.separator
            record["separator"] = {
                "placement": np.round(placement, 5).tolist(),
                "widths_mm": [round(width, 3) for width in widths_mm],
            }
        return record

    def line(self) -> str:
        """States the leaf's share, the poses of its parts, and a reason or remedy, in one line for people."""
        scatter = self.where.scatter
        if len(self.where.poses) == 1 and scatter < 1.0:
            why = "the plan was less sure of it than its trials: more particles of [search] may be"
        elif len(self.where.poses) == 1:
            far = f"{scatter:.1f} times the goal"
            why = f"nearly all others lie about it, within {far}: ask for less"
        elif self.separator is None:
            why = "no squeeze that was tried gives the first two different widths"
        else:
            (x, y, angle), (one, other) = self.separator.placement, self.separator.widths_mm
            hand = f"a hand at ({x:z.0f}, {y:z.0f}) mm, {math.degrees(angle):z.0f} deg"
            why = f"{hand} would read {one:.1f} mm for the first and {other:.1f} mm for the second"
        return f"leaf {self.leaf} ({self.share:.2%}): the part lies at {self.where.text()}; {why}"


def ambiguities(table: Table, evaluation: Evaluation, job: Job, most: int = 3) -> list[Ambiguity]:
    """Returns the unresolved leaves where most parts end, at most `most` of them, the most frequent first.

    Leaves with fewer than `LEAST_TRIALS` parts are left out.
    """
    visits = np.bincount(evaluation.leaf[evaluation.unresolved], minlength=len(table.leaves))
    commonest = np.argsort(-visits, kind="stable")[:most].tolist()
    metric = metric_of_table(table)
    simulator = Simulator.of_job(job, workers=1)
    results = []
    for leaf in (leaf for leaf in commonest if visits[leaf] >= LEAST_TRIALS):
        here = evaluation.poses[evaluation.leaf == leaf]
        where = whereabouts(here, metric)
        rng = np.random.default_rng([job.seed, leaf, SEED_AMBIGUITY])
        several = len(where.poses) > 1
        separator = _separator(where.poses[:2], job, simulator, rng) if several else None
        share = float(visits[leaf] / len(evaluation.leaf))
        results.append(Ambiguity(leaf, share, where, separator))
    return results


def whereabouts(here: Array, metric: Metric) -> Whereabouts:
    """Finds the main poses of parts that lie at `here` (n, 3), n >= 1, or their scatter about a single pose.

    A leaf may be unresolved although it has a single main pose. Its parts farther than `APART` from this pose
    may then lie at another pose. If they are more than half of the parts outside the goal, their most
    frequent pose is added as a second main pose. Otherwise the result states how far the remaining parts
    scatter about the single pose.
    """
    modes = main_poses(here, metric)
    if len(modes) == 1:
        distance = metric.between(here, modes[0].pose) / metric.goal
        far = distance > APART
        outside = np.sum(distance >= 1.0)
        if 2 * np.sum(far) <= outside:
            scatter = float(np.max(distance[~far]))
            return Whereabouts(modes[0].pose[None], (modes[0].ratio,), scatter)
        other = metric.main_modes(here[far], 1)[0]
        modes.append(other._replace(ratio=other.ratio * float(np.mean(far))))
    return Whereabouts(np.array([mode.pose for mode in modes]), tuple(mode.ratio for mode in modes))


def _separator(pair: Array, job: Job, simulator: Simulator, rng: Generator) -> Separator | None:
    """Finds the squeeze whose mean widths at two poses differ most, in units of their scatter.

    A squeeze that holds the part in both poses is preferred to all squeezes that miss it in one of them.

    Returns:
        The squeeze; None if none of `HANDS` placements distinguishes the poses.
    """
    encoder = encoder_of(job)
    # The standard deviation of rounding is the step over the square root of 12.
    floor = math.hypot(encoder.noise_mm, encoder.mm_per_step / math.sqrt(12.0))
    best, clearest = None, (False, TELLING)
    hands = hands_about(reach(job.part.outline_mm), 0.5 * job.gripper.finger_length_mm, HANDS)
    middle = np.array([*pair[:, :2].mean(axis=0), pair[0, 2]])
    about = placed(hands, middle)
    about[:, 2] = wrap(about[:, 2], HALF_TURN_ALIKE)
    for placement in actions_of(job).within(about):
        if least_clearance(simulator.outline, simulator.jaws, pair, placement) < 0.0:
            continue
        hand = np.repeat(to_hand(pair, placement), SAMPLES, axis=0)
        rolled = simulator.roll_out(hand, simulator.sample(len(hand), rng))
        width = rolled.width_mm.reshape(2, SAMPLES)
        one, other = width.mean(axis=1)
        clarity = abs(one - other) / math.sqrt(float((width.var(axis=1) + floor**2).sum()))
        # A hand that misses the part in one of the poses distinguishes them, but does not move the
        # part.
        rank = (bool(min(one, other) >= HELD_UM / 1e3), clarity)
        if clarity > TELLING and rank > clearest:
            best, clearest = Separator(placement, (float(one), float(other))), rank
    return best


def pose_text(pose: Array) -> str:
    """Formats a pose (3,) [mm, mm, rad] in millimetres and degrees."""
    return f"({pose[0]:z.1f}, {pose[1]:z.1f}) mm {math.degrees(math.remainder(pose[2], math.tau)):z.0f} deg"
