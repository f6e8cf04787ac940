"""Compares a table's leaves with fresh trials: their stated probabilities, and leaves that are confused."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.evaluation.judge import metric_of_table, states_of
from planner.evaluation.outcome import NOWHERE, Evaluation
from planner.evaluation.trials import encoder_of_table
from runtime.table import PPM, Table, poses_of

NO_LEAF = -1
LEAST_VISITS = 200  # least visits of a leaf that is compared
TAIL = 0.025  # probability beyond either end of an interval
JEFFREYS = 0.5  # both parameters of the beta distribution that is Jeffreys' prior


class LeafRecord(NamedTuple):
    """Predicted and observed success of one leaf; its fields are the fields of the JSON output."""

    leaf: int  # index of the leaf
    visits: int  # trials that ended at the leaf
    predicted: float  # success probability that the table states
    predicted_trials: int  # number of trials behind the table's figure
    observed: float  # share of the visits in which the leaf's pose was within the goal
    # central 95 % interval of the observed share, if the prediction is right
    interval95: tuple[float, float]
    holds: bool  # whether the observed share lies in the interval


class Reliability(NamedTuple):
    """The reliability table: predicted and observed success of the leaves."""

    rows: tuple[LeafRecord, ...]  # leaves with enough visits, in the order of the table
    gap: float  # mean distance of observed from predicted probability, weighted by visits

    @property
    def share(self) -> float:
        """Share of the rows whose prediction holds; 1 if there are no rows."""
        return sum(row.holds for row in self.rows) / len(self.rows) if self.rows else 1.0

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        rows = [row._asdict() for row in self.rows]
        shares = {"share_within_95": self.share, "mean_gap": self.gap}
        return {"leaves": len(rows), **shares, "table": rows}


def reliability(table: Table, evaluation: Evaluation) -> Reliability:
    """Compares the leaves' predictions with fresh trials; leaves with fewer than `LEAST_VISITS` are left out.

    The probability that the table states is itself an estimate: k hits in n trials. Under Jeffreys' prior the
    number of hits among m further trials is then beta-binomial with Beta(k + 1/2, n - k + 1/2). The
    prediction holds if the observed number lies in the central 95 % of this distribution.
    """
    from scipy.stats import betabinom  # importing scipy.stats takes a second

    rows = []
    for index, leaf in enumerate(table.leaves):
        here = evaluation.leaf == index
        visits = int(here.sum())
        if visits < LEAST_VISITS:
            continue
        predicted, hits = leaf.success_ppm / PPM, int(evaluation.within[here].sum())
        seen = predicted * leaf.trials
        prior = (seen + JEFFREYS, leaf.trials - seen + JEFFREYS)
        low, high = (int(betabinom.ppf(q, visits, *prior)) for q in (TAIL, 1.0 - TAIL))
        interval, holds = (low / visits, high / visits), low <= hits <= high
        observed = hits / visits
        rows.append(LeafRecord(index, visits, predicted, leaf.trials, observed, interval, holds))
    total = sum(row.visits for row in rows)
    gap = sum(row.visits * abs(row.observed - row.predicted) for row in rows) / max(total, 1)
    return Reliability(tuple(rows), float(np.round(gap, 12)))


class Confusion(NamedTuple):
    """Number of parts that ended at one leaf, but lay at the pose of another leaf or of none."""

    leaf: int  # leaf at which the parts ended
    truth: int  # leaf nearest to their pose; `NO_LEAF` if none is within the goal
    trials: int  # number of these parts
    share: float  # share of these parts in all trials
    resolved: bool  # whether `leaf` claims to know the pose


class Mistake(NamedTuple):
    """One trial with a confident wrong answer."""

    initial_pose: Array  # (3,) true pose before the first squeeze [mm, mm, rad]
    final_pose: Array  # (3,) true pose after the last squeeze
    predicted_pose: Array  # (3,) pose that the leaf states
    error_mm: float  # audit metric of the final pose to the nearest of the leaf's poses
    leaf: int  # leaf at which the trial ended
    path: tuple[int, ...]  # the nodes passed
    widths_mm: tuple[float, ...]  # widths that the encoder read at these nodes

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        poses = {name: _rounded(getattr(self, name)) for name in self._fields[:3]}
        return {**self._asdict(), **poses, "error_mm": round(self.error_mm, 3)}


class Identities(NamedTuple):
    """How often the leaves gave each name to the parts of each hypothesis."""

    names: tuple[str, ...]  # names of the hypotheses
    named: IntArray  # (h, h + 1) parts of each hypothesis by the name given; last column: none

    @property
    def right(self) -> float:
        """Share of right names among the names that leaves gave; 1 if they gave none."""
        named = self.named[:, :-1]
        return float(np.trace(named) / named.sum()) if named.any() else 1.0

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        total, named = self.named.sum(), self.named[:, :-1]
        return {
            "names": list(self.names),
            "identity_rate": self.right,
            "named_rate": float(named.sum() / total),
            "mistaken_rate": float((named.sum() - np.trace(named)) / total),
            "named": named.tolist(),
            "unnamed": self.named[:, -1].tolist(),
        }


def identities(table: Table, evaluation: Evaluation) -> Identities:
    """Counts how often the leaves gave each name to the parts of each hypothesis."""
    number = len(table.hypotheses)
    said = np.array([leaf.hypothesis for leaf in table.leaves])[np.maximum(evaluation.leaf, 0)]
    said = np.where(evaluation.resolved, said, number)
    named = np.zeros((number, number + 1), np.int64)
    np.add.at(named, (evaluation.traits["hypothesis"], said), 1)
    return Identities(tuple(hypothesis.name for hypothesis in table.hypotheses), named)


def nearest_leaf(table: Table, poses: Array) -> IntArray:
    """Index (n,) of the leaf with the pose nearest to each true pose (n, 3 or 4) in the world.

    The index is `NO_LEAF` for a true pose that is not within the goal of any leaf.
    """
    metric = metric_of_table(table)
    answers = (states_of(table, leaf) for leaf in table.leaves)
    distance = np.array([metric.between(poses[:, None], each).min(axis=1) for each in answers])
    nearest = np.argmin(distance, axis=0)
    return np.where(distance.min(axis=0) < metric.goal, nearest, NO_LEAF)


def confusions(table: Table, evaluation: Evaluation) -> list[Confusion]:
    """Counts the trials that ended at a wrong leaf, by that leaf and by the leaf nearest to the part.

    The most frequent pair comes first.
    """
    failed = (evaluation.leaf >= 0) & ~evaluation.within
    ended = evaluation.leaf[failed].tolist()
    truth = nearest_leaf(table, evaluation.states[failed]).tolist()
    n = len(evaluation.leaf)
    pairs = Counter(zip(ended, truth, strict=True))
    return [
        Confusion(leaf, true, count, count / n, table.leaves[leaf].resolved)
        for (leaf, true), count in sorted(pairs.items(), key=lambda item: (-item[1], item[0]))
    ]


def worst(table: Table, evaluation: Evaluation, most: int) -> list[Mistake]:
    """The confident wrong answers with the largest errors: `most` at most, the largest error first."""
    wrong = np.flatnonzero(evaluation.wrong)
    order = wrong[np.argsort(-evaluation.error_mm[wrong], kind="stable")][:most]
    encoder, mistakes = encoder_of_table(table), list[Mistake]()
    for trial in order:
        leaf, passed = int(evaluation.leaf[trial]), evaluation.path[trial] != NOWHERE
        poses = evaluation.initial[trial], evaluation.poses[trial]
        predicted = np.array(poses_of(table.goal, table.leaves[leaf])[0])
        error_mm, path = float(evaluation.error_mm[trial]), evaluation.path[trial][passed].tolist()
        widths_mm = (encoder.width_um(evaluation.steps[trial][passed]) / 1e3).tolist()
        mistakes.append(Mistake(*poses, predicted, error_mm, leaf, tuple(path), tuple(widths_mm)))
    return mistakes


def _rounded(pose: Array) -> list[float]:
    return [round(float(pose[0]), 3), round(float(pose[1]), 3), round(float(pose[2]), 5)]
