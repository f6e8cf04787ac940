"""Likelihood of observations in a cell: a synthetic likelihood (Wood 2010) of scores, learned by simulation.

Each outcome of a part has scores: the rates at which the log probability of the outcome grows with each
feature of the cell. The sums of the scores over all parts, one statistic for each feature, are nearly normal
and sufficient to distinguish neighbouring cells. The mean of the statistics is regressed on the features of
the cell, over simulated sets of as many parts as were observed. The residuals of the regression give the
scatter of the statistics, errors of the regression included. Scores and regression use different sets of
parts; otherwise chance would be taken for an effect of the features. Bad scores make a likelihood less sharp,
never too sure.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from planner.arrays import Array, IntArray
from planner.refit.outcomes import LINE

RARE = 30.0  # simulated parts with an outcome below which the scores of the outcome shrink to 0
CURVED = 3  # cells per coefficient above which the regression includes squares and products
RIDGE = 1e-6  # ridge of the regression, in units of the features' variance


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """How likely the observed outcomes are in a robot cell with given values of its k features.

    The likelihood is a Gaussian of k statistics of the outcomes; their mean is a regression, fitted to
    simulated cells, on p terms made of the features.
    """

    centre: Array  # (k,) mean of the features
    scale: Array  # (k,) standard deviation of the features
    curved: bool  # whether the terms include squares and products
    statistics: Array  # (k,) statistics of the observed parts
    slopes: Array  # (p, k) coefficients of the regression
    whiten: Array  # (k, k) scales the scatter of the statistics to unit variance
    doubt: Array  # (p, p) covariance of the slopes, in units of the scatter

    @classmethod
    def of(cls, features: Array, shown: IntArray, seen: Array, counts: int) -> Self:
        """Learns the likelihood of the observations from simulated cells, and returns it.

        Args:
            features: (m, k) features of the simulated cells.
            shown: (m, 2, n, d) outcome numbers: two sets of n parts for each cell, d outcomes for each part.
            seen: (size,) how often each outcome was observed, in n parts.
            counts: number of outcomes that have no order, such as readings. The other outcomes are steps of
                ordered quantities, `LINE` steps each.
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
        """Logarithm (n,) of the likelihood at features (n, k), up to a constant."""
        terms = _terms((features - self.centre) / self.scale, self.curved)
        # Far from all simulated cells the scatter is wider.
        wider = 1.0 + np.einsum("ij,ij->i", terms @ self.doubt, terms)
        off = (self.statistics - terms @ self.slopes) @ self.whiten.T
        return np.asarray(-0.5 * (off**2).sum(axis=1) / wider - 0.5 * off.shape[1] * np.log(wider))


def _scores(features: Array, shown: IntArray, size: int, counts: int) -> Array:
    """Estimates the scores (size + 1, k) of all outcomes from simulated cells.

    Each of m cells has k `features` and c simulated outcomes, whose outcome numbers `shown` (m, c) lists. The
    first `counts` of the `size` outcomes have no order. The others are steps of ordered quantities: their
    scores rise linearly from step to step, also at steps that no simulated part has. The last row of the
    result is 0, for parts without an outcome.
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
    """Regressors (n, p) of the means: 1, the features (n, k) and, if `curved`, their squares and products."""
    one, two = np.triu_indices(features.shape[1])
    products = features[:, one] * features[:, two] if curved else features[:, :0]
    return np.column_stack([np.ones(len(features)), features, products])
