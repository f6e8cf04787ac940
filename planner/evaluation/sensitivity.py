"""What limits a table: its success with one source of noise after another switched off."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from planner.evaluation.statistics import Z95
from planner.evaluation.sweep import Case, sweep
from planner.job.model import Job
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

SEED_SENSITIVITY = 0x53454E53
STEADY_DOF = "1000000"
"""Degrees of freedom at which the limit surface no longer scatters."""
EVERYTHING = "all of them"


class Gain(NamedTuple):
    """What one source of noise costs.

    Attributes:
        source: its name; `EVERYTHING` for the run without any.
        success_rate: of the table without that source.
        gain: how much higher that is than with all of them.
        error: half-width of the gain's 95 % interval.
    """

    source: str
    success_rate: float
    gain: float
    error: float

    @property
    def certain(self) -> bool:
        """Whether the gain is more than chance."""
        return self.gain > self.error

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "certain": self.certain}


def noise_sources(job: Job) -> list[Case]:
    """The job's sources of noise, each with the overrides that switch it off; at last all together."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    middle = repr(0.5 * (low + high))
    sources = [Case("pressure", (("pressure.wishart_dof", STEADY_DOF),))]
    if high > low:
        fixed = (("friction.finger_part_min", middle), ("friction.finger_part_max", middle))
        sources.append(Case("friction", fixed))
    if job.gripper.encoder_noise_mm > 0.0:
        sources.append(Case("encoder noise", (("gripper.encoder_noise_mm", "0"),)))
    if job.release.shift_mm > 0.0 or job.release.turn_deg > 0.0:
        sources.append(Case("release", (("release.shift_mm", "0"), ("release.turn_deg", "0"))))
    return [
        *sources,
        Case(EVERYTHING, tuple(override for source in sources for override in source.overrides)),
    ]


def sensitivity(
    table: Table,
    job: Job,
    trials: int,
    scheduler: Scheduler | None = None,
    report: Report = silent,
) -> list[Gain]:
    """Runs a table without one source of noise after another; the table stays what it is.

    Args:
        table: the table.
        job: the job it was compiled from.
        trials: number of parts for each source, and for the run with all of them.
        scheduler: who runs them; all cores if None. The result does not depend on it.
        report: told about progress.

    Returns:
        One gain a source, the largest first, then the one without any noise.
    """
    cases = [Case("as planned"), *noise_sources(job)]
    rates = []
    lines = sweep(
        table, job, cases, lambda real: ContactWorlds.of_job(real, job.seed + SEED_SENSITIVITY), trials,
        job.seed + SEED_SENSITIVITY, scheduler,
    )  # fmt: skip
    for line in lines:
        rates.append(float(line.evaluation.success.mean()))
        report("sensitivity", len(rates), len(cases))
    base, *others = rates
    gains = [_gain(case.name, base, rate, trials) for case, rate in zip(cases[1:], others, strict=True)]
    return [*sorted(gains[:-1], key=lambda gain: -gain.gain), gains[-1]]


def _gain(source: str, base: float, rate: float, trials: int) -> Gain:
    # Rates of 1 scatter too: each counts as half a failure at least.
    variance = sum(max(p * (1.0 - p), 0.5 / trials) / trials for p in (base, rate))
    return Gain(source, rate, rate - base, Z95 * math.sqrt(variance))
