"""Advice on a plan that locates too few parts: which parts are not located, why, and what to change.

The cost of each source of noise in the job is measured by switching the source off.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from planner.belief.observation import encoder_of
from planner.diagnosis.ambiguity import Ambiguity, ambiguities
from planner.diagnosis.margins import Margins, margins_of
from planner.evaluation.cases import EVERYTHING, PLANNED, Case, noise_cases
from planner.evaluation.evaluate import sweep
from planner.evaluation.outcome import Evaluation
from planner.evaluation.shares import Shares, shares_of
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from runtime.table import Table

Z95 = NormalDist().inv_cdf(0.975)
SEED_NOISE = 0x53454E53
MOST_TRIALS = 5000  # parts squeezed for each source of noise
PINCHED = "as something thinner than a count is between the jaws and they read as closed"


class Gain(NamedTuple):
    """The success rate that a table gains without one source of noise."""

    source: str  # name of the source; `EVERYTHING` for the run without any noise
    success_rate: float  # success rate of the table without the source
    gain: float  # increase over the success rate with all sources
    error: float  # half-width of the gain's 95 % interval
    certain: bool  # whether the gain exceeds `error`


def gains_without_noise(
    table: Table, job: Job, trials: int, scheduler: Scheduler | None = None, report: Report = silent
) -> list[Gain]:
    """Measures by how much the success rate of a table rises without each source of its job's noise.

    The table stays the same; the sources are switched off one at a time.

    Returns:
        One gain for each source, the largest first, then the gain of the run without any noise.
    """
    seed = job.seed + SEED_NOISE
    cases = [Case(PLANNED), *noise_cases(job)]
    lines = sweep(table, job, cases, trials, seed, scheduler, report)
    base, *others = (float(line.evaluation.success.mean()) for line in lines)
    gains = []
    for case, rate in zip(cases[1:], others, strict=True):
        # Rates of 1 scatter too: each counts as at least half a failure.
        variance = sum(max(p * (1.0 - p), 0.5 / trials) / trials for p in (base, rate))
        gain, error = rate - base, Z95 * math.sqrt(variance)
        gains.append(Gain(case.name, rate, gain, error, gain > error))
    return [*sorted(gains[:-1], key=lambda gain: -gain.gain), gains[-1]]


def _noise_lines(gains: Sequence[Gain]) -> list[str]:
    """States the sources of noise that limit the plan, and the failures that remain without noise."""
    if not gains:
        return []
    single = [gain for gain in gains if gain.source != EVERYTHING]
    lines = [
        f"{gain.source} limits it: without its scatter {gain.gain:.2%} +- {gain.error:.2%} more"
        for gain in single
        if gain.certain
    ]
    if not lines:
        measured = ", ".join(f"{gain.source} {gain.gain:+.2%}" for gain in single)
        lines.append(f"no source of noise alone limits this plan: {measured}")
    missing = 1.0 - gains[-1].success_rate
    rest = f"{missing:.2%} would not be located without any noise either"
    return [*lines, f"{rest}: extend the action set"]


class Advice(NamedTuple):
    """The share of parts that are not located, by cause, and the remedies."""

    failing: float  # share of the parts that are not located
    rejected: float  # share whose width no branch has
    pinched: float  # share that is rejected because jaws that hold the part read as closed
    unresolved: float  # share that ends in unresolved leaves
    at_depth_limit: float  # share that ends in unresolved leaves at `search.max_depth`
    open_poses: list[Ambiguity]  # the unresolved leaves with most parts, and their remedies
    gains: Sequence[Gain]  # cost of each source of noise; empty if not measured
    proposing: bool  # whether the search proposed placements besides the job's
    shares: Shares  # of parts located, rejected and unresolved, rounded as in other reports
    margins: Margins | None = None  # effect of a small offset of widths; None if not asked for

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        record = self._asdict() | {
            "open_poses": [leaf.figures() for leaf in self.open_poses],
            "gains": [gain._asdict() for gain in self.gains],
            "margins": self.margins and {**self.margins._asdict(), "thin": self.margins.thin},
        }
        del record["proposing"], record["shares"]
        return record

    def lines(self) -> list[str]:
        """States for people which parts are not located, why, and what to change."""
        return [
            *self._shares(),
            *(leaf.line() for leaf in self.open_poses),
            *([self.margins.line()] if self.margins and self.margins.thin else []),
        ]

    def _shares(self) -> list[str]:
        if self.failing == 0.0:
            return ["every part was located"]
        failing = 1.0 - 0.01 * self.shares.located
        rejected, unresolved = 0.01 * self.shares.rejected, 0.01 * self.shares.unresolved
        lines = [f"{failing:.2%} of the parts are not located"]
        if self.pinched > 0.5 * self.failing:
            lines.append(f"{min(self.pinched, rejected):.2%} are rejected, {PINCHED}")
        if self.unresolved > 0.0:
            lines.append(
                f"{unresolved:.2%} end unresolved, where no squeeze that was tried gained anything: "
                "add angles or centres" + ("" if self.proposing else ", or plan with proposals")
            )
        if self.at_depth_limit > 0.0:
            deep = f"{self.at_depth_limit:.2%} end unresolved at max_depth of [search]"
            lines.append(f"{deep}: raise it")
        return lines + _noise_lines(self.gains)


def advise(
    table: Table,
    evaluation: Evaluation,
    job: Job,
    gains: Sequence[Gain] = (),
    margins: Margins | None = None,
) -> Advice:
    """Returns the advice on a plan, from the evaluation of its table and, if given, gains and margins."""
    last = evaluation.reading[np.arange(len(evaluation.leaf)), evaluation.squeezes - 1]
    deep = evaluation.unresolved & (evaluation.squeezes >= job.search.max_depth)
    return Advice(
        failing=1.0 - float(evaluation.success.mean()),
        rejected=float(evaluation.rejected.mean()),
        pinched=float(np.mean(evaluation.rejected & (last == 2 * encoder_of(job).steps + 1))),
        unresolved=float(evaluation.unresolved.mean()),
        at_depth_limit=float(deep.mean()),
        open_poses=[] if job.hypothesis else ambiguities(table, evaluation, job),
        gains=gains,
        proposing=job.actions.proposals != "none",
        margins=margins,
        shares=shares_of(evaluation.summary()),
    )


def counsel(
    table: Table,
    evaluation: Evaluation,
    job: Job,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> Advice:
    """Runs trials to measure the gains and margins of a plan, and returns the advice based on them.

    `table` and `evaluation` come from a plan of `planner.compile.compile_job`.
    """
    trials = min(len(evaluation.leaf), MOST_TRIALS)
    gains = gains_without_noise(table, job, trials, scheduler, report)
    margins = margins_of(table, evaluation, job, trials, scheduler, report)
    return advise(table, evaluation, job, gains, margins)
