"""What a job's sources of noise cost its plan: success of the table with one after another switched off."""

import math
from collections.abc import Sequence
from functools import partial
from statistics import NormalDist
from typing import Any, NamedTuple

from planner.evaluation.cases import EVERYTHING, PLANNED, Case, noise_cases
from planner.evaluation.evaluate import sweep
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

Z95 = NormalDist().inv_cdf(0.975)
SEED_NOISE = 0x53454E53


class Gain(NamedTuple):
    """What one source of noise costs."""

    source: str  # its name; `EVERYTHING` for the run without any
    success_rate: float  # of the table without that source
    gain: float  # how much higher that is than with all of them
    error: float  # half-width of the gain's 95 % interval

    @property
    def certain(self) -> bool:
        """Whether the gain is more than chance."""
        return self.gain > self.error

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "certain": self.certain}


def gains_without_noise(
    table: Table, job: Job, trials: int, scheduler: Scheduler | None = None, report: Report = silent
) -> list[Gain]:
    """Runs a table without one source of its job's noise after another; the table stays what it is.

    Returns:
        One gain a source, the largest first, then the one without any noise.
    """
    seed = job.seed + SEED_NOISE
    cases, worlds = [Case(PLANNED), *noise_cases(job)], partial(ContactWorlds.of_job, seed=seed)
    lines = sweep(table, job, cases, worlds, trials, seed, scheduler, report)
    base, *others = (float(line.evaluation.success.mean()) for line in lines)
    gains = [_gain(case.name, base, rate, trials) for case, rate in zip(cases[1:], others, strict=True)]
    return [*sorted(gains[:-1], key=lambda gain: -gain.gain), gains[-1]]


def lines_of(gains: Sequence[Gain]) -> list[str]:
    """For people: which sources of noise limit the plan, and what stays without any."""
    if not gains:
        return []
    single = [gain for gain in gains if gain.source != EVERYTHING]
    lines = [
        f"{gain.source} limits it: {gain.gain:.2%} more, give or take {gain.error:.2%}, if it did not scatter"
        for gain in single
        if gain.certain
    ]
    if not lines:
        measured = ", ".join(f"{gain.source} {gain.gain:+.2%}" for gain in single)
        lines.append(f"no source of noise alone limits this plan: {measured}")
    missing = 1.0 - gains[-1].success_rate
    return [*lines, f"{missing:.2%} would not be located without any noise: that is up to the action set"]


def _gain(source: str, base: float, rate: float, trials: int) -> Gain:
    # Rates of 1 scatter too: each counts as half a failure at least.
    variance = sum(max(p * (1.0 - p), 0.5 / trials) / trials for p in (base, rate))
    return Gain(source, rate, rate - base, Z95 * math.sqrt(variance))
