"""An evaluation in words and columns, for people."""

import math

import numpy as np

from planner.evaluation.leaves import LEAST_VISITS, NO_LEAF, Confusion, Identities, Mistake, Reliability
from planner.evaluation.outcome import Evaluation
from runtime.table import Table

MOST_ROWS = 8


def overview(evaluation: Evaluation, world: str) -> list[str]:
    """The rates, squeezes and seconds."""
    figures = evaluation.summary()
    low, high = figures["success_ci95"]
    taken, most = np.bincount(evaluation.squeezes), figures["max_squeezes"]
    spread = ", ".join(f"{k}: {share:.1%}" for k, share in enumerate(taken / taken.sum()) if share > 0)
    return [
        f"{figures['trials']} parts in {world}",
        f"success    {figures['success_rate']:7.2%}  95 % interval {low:.2%} to {high:.2%}",
        f"wrong      {figures['wrong_rate']:7.2%}  confident, but not within the goal",
        f"rejected   {figures['reject_rate']:7.2%}",
        f"unresolved {figures['unresolved_rate']:7.2%}",
        f"squeezes   {figures['mean_squeezes']:7.2f}  a part, up to {most} here ({spread})",
        f"seconds    {figures['mean_seconds']:7.1f}  a part, estimated",
        *_error(figures["error_mm"]),
        f"crashes    {figures['crashes']:7d}  parts that a finger came down on: failures",
    ]


def worst_world(world: str, evaluation: Evaluation) -> str:
    """The worst of the worlds that the job believes in."""
    figures = evaluation.summary()
    rates = f"wrong {figures['wrong_rate']:.2%}, success {figures['success_rate']:.2%}"
    return f"worst      {rates} of {figures['trials']} parts in the worst believed world: {world}"


def named(found: Identities) -> list[str]:
    """How often the right part was named, and which was named for which."""
    figures = found.figures()
    told = f"of the parts that were named ({figures['named_rate']:.2%})"
    lines = [f"identity   {found.right:7.2%}  right, {told}"]
    for truth, row in zip(found.names, found.named, strict=True):
        wrong = {
            name: int(count) for name, count in zip(found.names, row, strict=False) if count and name != truth
        }
        lines += [
            f"           {count} of {row.sum()} {truth} were named {name}" for name, count in wrong.items()
        ]
    return lines


def _error(error_mm: dict[str, float] | None) -> list[str]:
    if error_mm is None:
        return []
    share = f"95 % within {error_mm['p95']:.2f} mm"
    return [f"error      {error_mm['median']:7.2f}  mm median where resolved, {share}"]


def predictions(table: Table, outcome: Reliability) -> list[str]:
    """Whether the leaves' probabilities hold, and those that do not."""
    held, total = sum(row.holds for row in outcome.rows), len(outcome.rows)
    if total == 0:
        return [f"leaves     no leaf of {len(table.leaves)} has {LEAST_VISITS} visits; raise --trials"]
    share = f"{held} of {total} with {LEAST_VISITS} visits or more"
    lines = [f"leaves     {share} do as the table predicts ({outcome.share:.0%})"]
    failed = sorted((row for row in outcome.rows if not row.holds), key=lambda row: -row.visits)
    for row in failed[:MOST_ROWS]:
        low, high = row.interval95
        lines.append(
            f"           leaf {row.leaf}: {row.observed:.2%} of {row.visits}, predicted {row.predicted:.2%}, "
            f"with 95 % between {low:.2%} and {high:.2%}"
        )
    return lines + _more(len(failed))


def taken_for(confused: list[Confusion]) -> list[str]:
    """Which leaf was taken for which."""
    lines: list[str] = []
    for row in confused[:MOST_ROWS]:
        truth = "where no leaf is" if row.truth == NO_LEAF else f"at leaf {row.truth}"
        claim = "" if row.resolved else ", unresolved"
        head = "           " if lines else "taken      "
        lines.append(f"{head}for leaf {row.leaf}{claim}: {row.trials} parts that lay {truth}")
    return lines + _more(len(confused))


def furthest(mistakes: list[Mistake]) -> list[str]:
    """Where the worst errors began and how they went."""
    lines: list[str] = []
    for row in mistakes:
        x, y, theta = row.initial
        path = " > ".join(map(str, row.path))
        counts = ", ".join(map(str, row.counts))
        head = "           " if lines else "worst      "
        lines.append(
            f"{head}{row.error_mm:.1f} mm off, from ({x:.1f}, {y:.1f}) mm at {math.degrees(theta):.0f} deg, "
            f"nodes {path} > leaf {row.leaf}, counts {counts}"
        )
    return lines


SWEEP_HEAD = f"{'world':31s} success    wrong reject unresolved squeezes seconds"


def sweep_row(world: str, evaluation: Evaluation) -> str:
    """One world of a sweep, in the columns of `SWEEP_HEAD`."""
    figures = evaluation.summary()
    return (
        f"{world:31s} {figures['success_rate']:7.2%} {figures['wrong_rate']:8.2%} "
        f"{figures['reject_rate']:6.2%} {figures['unresolved_rate']:10.2%} {figures['mean_squeezes']:8.2f} "
        f"{figures['mean_seconds']:7.1f}"
    )


def _more(rows: int) -> list[str]:
    return [f"           and {rows - MOST_ROWS} more; see --json"] if rows > MOST_ROWS else []
