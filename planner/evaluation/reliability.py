"""Whether the leaves' success probabilities hold: predicted against observed, leaf by leaf."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from planner.evaluation.outcome import Evaluation
from runtime.table import PPM, Table

LEAST_VISITS = 200
"""Leaves visited less often say too little."""
TAIL = 0.025
JEFFREYS = 0.5


class LeafRecord(NamedTuple):
    """One leaf's account.

    Attributes:
        leaf: its index.
        visits: trials that ended there.
        hits: trials of these in which its pose was within the goal.
        predicted: success probability that the table states.
        trials: on how many trials the table's figure rests.
        low: least number of hits that 95 % of such counts lie within, if the prediction is right.
        high: greatest.
    """

    leaf: int
    visits: int
    hits: int
    predicted: float
    trials: int
    low: int
    high: int

    @property
    def holds(self) -> bool:
        """Whether the observation lies in the interval of the prediction."""
        return self.low <= self.hits <= self.high


@dataclass(frozen=True, slots=True)
class Reliability:
    """The reliability table.

    Attributes:
        rows: leaves with enough visits, in the order of the table.
        gap: mean distance of observed from predicted probability over these leaves, weighted by visits.
    """

    rows: tuple[LeafRecord, ...]
    gap: float

    @property
    def share(self) -> float:
        """Share of the leaves whose prediction holds; 1 where there are none."""
        return sum(row.holds for row in self.rows) / len(self.rows) if self.rows else 1.0

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        rows = [
            {
                "leaf": row.leaf,
                "visits": row.visits,
                "predicted": row.predicted,
                "predicted_trials": row.trials,
                "observed": row.hits / row.visits,
                "interval95": [row.low / row.visits, row.high / row.visits],
                "holds": row.holds,
            }
            for row in self.rows
        ]
        return {"leaves": len(rows), "share_within_95": self.share, "mean_gap": self.gap, "table": rows}


def reliability(table: Table, evaluation: Evaluation, least_visits: int = LEAST_VISITS) -> Reliability:
    """Holds the leaves' predictions against fresh trials.

    The table's figure is itself an estimate: k hits in n trials. Under Jeffreys' prior the number of hits
    among m further trials is then beta-binomial with Beta(k + 1/2, n - k + 1/2); the interval is its central
    95 %.

    Args:
        table: states the predictions.
        evaluation: trials it was not made from.
        least_visits: leaves with fewer are left out.
    """
    from scipy.stats import betabinom  # takes a second

    rows = []
    for index in range(len(table.leaves)):
        here = evaluation.leaf == index
        visits = int(here.sum())
        if visits < max(least_visits, 1):
            continue
        leaf = table.leaves[index]
        predicted, hits = leaf.success_ppm / PPM, int(evaluation.within[here].sum())
        seen = predicted * leaf.trials
        prior = (seen + JEFFREYS, leaf.trials - seen + JEFFREYS)
        low, high = (int(betabinom.ppf(q, visits, *prior)) for q in (TAIL, 1.0 - TAIL))
        rows.append(LeafRecord(index, visits, hits, predicted, leaf.trials, low, high))
    total = sum(row.visits for row in rows)
    gap = sum(abs(row.hits - row.predicted * row.visits) for row in rows) / max(total, 1)
    return Reliability(tuple(rows), float(np.round(gap, 12)))
