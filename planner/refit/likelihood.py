"""How likely what was seen is in a cell: a synthetic likelihood (Wood 2010) of scores, learned by simulation.

Each outcome of a part has scores: how much likelier it grows with each feature of the cell. Their sums over
all parts are as many statistics as there are features, nearly normal, and all that tells of cells near each
other. Their mean in a cell is regressed on its features, over simulated sets of as many parts as were seen;
what the regression leaves is how they scatter, its own misfit included. Scores and regression take
different sets, or chance would be taken for a slope. Bad scores make a likelihood less sharp, never too sure.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from planner.arrays import Array, IntArray
from planner.refit.outcomes import LINE

RARE = 30.0  # simulated outcomes below which a score is drawn to 0
CURVED = 3  # cells for each coefficient from which squares and products are regressed on, too
RIDGE = 1e-6  # of the regression, in units of the features' variance


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """Of cells by k features: k statistics as seen, and their mean and scatter by p terms of the features."""

    centre: Array  # (k,) of the features
    scale: Array  # (k,)
    curved: bool  # whether the terms hold squares and products
    statistics: Array  # (k,)
    slopes: Array  # (p, k)
    whiten: Array  # (k, k) what makes the scatter's covariance the unit matrix
    doubt: Array  # (p, p) covariance of the slopes, in units of the scatter

    @classmethod
    def of(cls, features: Array, shown: IntArray, seen: Array, counts: int) -> Self:
        """Learns the likelihood of what was seen.

        Args:
            features: (m, k) of the simulated cells.
            shown: (m, 2, n, d) two sets of n parts in each, with the numbers of each part's outcomes.
            seen: (size,) how often n parts showed each outcome.
            counts: so many outcomes stand for themselves; the others are steps along lines, `LINE` on each.
        """
        centre, scale = features.mean(axis=0), features.std(axis=0) + 1e-12
        m, k = features.shape
        curved = len(np.unique(features, axis=0)) > CURVED * (k + 1) * (k + 2) // 2
        terms = _terms((features - centre) / scale, curved)
        scores = _scores(terms[:, 1 : k + 1], shown[:, 0].reshape(m, -1), len(seen), counts)
        simulated = scores[shown[:, 1].reshape(m, -1)].sum(axis=1)
        doubt = np.linalg.inv(terms.T @ terms + RIDGE * m * np.eye(terms.shape[1]))
        slopes = doubt @ terms.T @ simulated
        left = simulated - terms @ slopes
        covariance = left.T @ left / max(1, m - terms.shape[1])
        covariance += 1e-9 * (np.trace(covariance) + 1e-9) * np.eye(k)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        return cls(centre, scale, curved, seen @ scores[:-1], slopes, whiten, doubt)

    def log(self, features: Array) -> Array:
        """Its logarithm (n,) at features (n, k), but for a constant."""
        terms = _terms((features - self.centre) / self.scale, self.curved)
        wider = 1.0 + np.einsum(
            "ij,ij->i", terms @ self.doubt, terms
        )  # far from all cells simulated
        off = (self.statistics - terms @ self.slopes) @ self.whiten.T
        return np.asarray(-0.5 * (off**2).sum(axis=1) / wider - 0.5 * off.shape[1] * np.log(wider))


def _scores(features: Array, shown: IntArray, size: int, counts: int) -> Array:
    """Scores (size + 1, k) of outcomes by what cells (m, k) showed (m, c); of the last, none, they are 0.

    Along a line they rise evenly, beyond the steps that simulated parts showed, too.
    """
    ends = np.arange(0, shown.size + 1, shown.shape[1])
    often = csr_array((np.ones(shown.size), shown.ravel(), ends), shape=(len(shown), size + 1))
    grown, total = often.T @ features, often.sum(axis=0)
    scores = grown / (total + RARE)[:, None]
    weights = total[counts:size].reshape(-1, LINE)
    middle = weights @ np.arange(LINE) / np.maximum(1.0, weights.sum(axis=1))
    off = np.arange(LINE) - middle[:, None]
    lines = np.einsum("ij,ijk->ik", off, grown[counts:size].reshape(*off.shape, features.shape[1]))
    lines /= RARE + (weights * off**2).sum(axis=1)[:, None]
    scores[counts:size] = (off[..., None] * lines[:, None]).reshape(-1, features.shape[1])
    scores[-1] = 0.0
    return np.asarray(scores)


def _terms(features: Array, curved: bool) -> Array:
    """What means are linear in (n, p): 1, features (n, k), and their products with each other."""
    one, two = np.triu_indices(features.shape[1])
    products = features[:, one] * features[:, two] if curved else features[:, :0]
    return np.column_stack([np.ones(len(features)), features, products])
