"""The outcomes of many trials of a table, with one row for each part, and the figures of all trials."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.evaluation.judge import errors_mm, within_goal
from planner.evaluation.times import seconds_of
from planner.mechanics.traits import Traits, with_hypothesis
from runtime.table import Table, takt_figures, wilson_interval

REJECTED = -1
CRASHED = -3  # an open finger came down on the part, and the arm stopped
NOWHERE = -1
ERROR_SHARES = (0.5, 0.95)
"""Percentiles of the error that are stated: the median, and nearly all parts."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The outcome of each of n trials."""

    table: Table  # the table that ran
    leaf: IntArray  # (n,) the leaf reached, `REJECTED` where a width fitted no branch, or `CRASHED`
    squeezes: IntArray  # (n,) number of squeezes
    poses: Array  # (n, 3) true final poses, in the arm's frame
    initial: Array  # (n, 3) true poses before the first squeeze
    traits: Traits  # (n,) latent parameters of each part and its cell
    path: IntArray  # (n, d) the nodes passed, in order, then `NOWHERE`
    # (n, d) twice the encoder's reading at each node, plus 1 if a part was felt; then `NOWHERE`
    reading: IntArray
    branch: IntArray  # (n, d) the branch taken at each node; `REJECTED` for none, then `NOWHERE`

    @cached_property
    def error_mm(self) -> Array:
        """(n,) audit metric from the true pose to the leaf's nearest pose [mm]; infinite without a leaf."""
        return errors_mm(self.table, self.leaf, self.states)

    @cached_property
    def within(self) -> BoolArray:
        """(n,) whether the true pose is within the goal of some pose of the leaf."""
        return within_goal(self.table, self.leaf, self.states)

    @cached_property
    def resolved(self) -> BoolArray:
        """(n,) whether the trial ended in a leaf that claims to know the pose."""
        known = np.array([leaf.resolved for leaf in self.table.leaves])
        return np.asarray((self.leaf >= 0) & known[np.maximum(self.leaf, 0)])

    @cached_property
    def seconds(self) -> Array:
        """(n,) duration of each trial, estimated by the table's model of time [s]; computed on first use."""
        return seconds_of(self.table, self.path, self.reading, self.branch)

    @property
    def steps(self) -> IntArray:
        """(n, d) the encoder's reading at each node passed, then `NOWHERE`."""
        return np.asarray(self.reading >> 1)  # `NOWHERE` is -1, which the shift keeps

    @property
    def states(self) -> Array:
        """(n, 3) final poses, with the hypothesis as a fourth column unless all parts have the first one."""
        return with_hypothesis(self.poses, self.traits)

    @property
    def success(self) -> BoolArray:
        """(n,) whether the trial ended in a resolved leaf, with the true pose within the goal."""
        return np.asarray(self.resolved & self.within)

    @property
    def wrong(self) -> BoolArray:
        """(n,) whether the trial ended in a resolved leaf, but the true pose is not within the goal."""
        return np.asarray(self.resolved & ~self.within)

    @property
    def rejected(self) -> BoolArray:
        """(n,) whether the trial ended at a width that fitted no branch."""
        return np.asarray(self.leaf == REJECTED)

    @property
    def unresolved(self) -> BoolArray:
        """(n,) whether the trial ended in a leaf that does not claim to know the pose."""
        return np.asarray((self.leaf >= 0) & ~self.resolved)

    @property
    def crashes(self) -> int:
        """Number of trials that ended with an open finger on the part."""
        return int(np.sum(self.leaf == CRASHED))

    def summary(self, takt_s: float | None = None) -> dict[str, Any]:
        """The figures of `plan-evaluate --json`; with a takt [s], also the share of parts done within it."""
        n, known = len(self.leaf), self.error_mm[self.resolved]
        errors = np.quantile(known, ERROR_SHARES).tolist() if len(known) else []
        successes, wrong = int(self.success.sum()), int(self.wrong.sum())
        return {
            "trials": n,
            "success_rate": successes / n,
            "success_ci95": list(wilson_interval(successes, n)),
            "wrong_rate": wrong / n,
            "wrong_ci95": list(wilson_interval(wrong, n)),
            "reject_rate": float(self.rejected.mean()),
            "unresolved_rate": float(self.unresolved.mean()),
            "mean_squeezes": float(self.squeezes.mean()),
            "max_squeezes": int(self.squeezes.max()),
            **takt_figures(Counter(self.seconds.tolist()), takt_s),
            "crashes": self.crashes,
            "error_mm": dict(zip(("median", "p95"), errors, strict=True)) if errors else None,
        }

    def of_rows(self, rows: IntArray) -> Self:
        """An evaluation with only the trials `rows`, in this order; an index may occur several times."""
        return type(self)(self.table, *(column[rows] for column in self._columns()))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Joins evaluations of one table, at least one, into an evaluation of all their trials in order."""
        columns = zip(*(part._columns() for part in parts), strict=True)
        return cls(parts[0].table, *map(np.concatenate, columns))

    def _columns(self) -> list[Any]:
        return [getattr(self, field.name) for field in fields(self)[1:]]
