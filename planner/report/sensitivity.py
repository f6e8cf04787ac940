"""How a table fares where the world is not as its job says: one assumption broken at a time."""

from __future__ import annotations

from typing import NamedTuple

from planner.evaluation.evaluate import evaluate
from planner.evaluation.statistics import wilson_interval
from planner.job.model import Job
from planner.job.overrides import job_with
from planner.world import make
from runtime.table import Table

UNEVEN = 0.02
"""How much more of the way one finger makes: 1.3 mm where the jaws close by 64."""
Change = tuple[str, tuple[tuple[str, str], ...]]


class Finding(NamedTuple):
    """Success in one world; `low` and `high` bound it with 95 % confidence (Wilson)."""

    world: str
    success: float
    low: float
    high: float
    rejected: float
    wrong: float
    squeezes: float


def changes(job: Job) -> list[Change]:
    """The worlds to try: what they are, and the job's values that they replace."""
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    noise = job.gripper.encoder_noise_mm
    share = job.gripper.upper_finger_share + (UNEVEN if job.gripper.upper_finger_share < 0.9 else -UNEVEN)
    found: list[Change] = [
        ("as the job says", ()),
        (f"friction only {low:g}", (("friction.finger_part_max", repr(low)),)),
        (f"friction only {high:g}", (("friction.finger_part_min", repr(high)),)),
        (
            f"friction {0.5 * low:.3g}, half the least",
            (("friction.finger_part_min", repr(0.5 * low)), ("friction.finger_part_max", repr(0.5 * low))),
        ),
        (
            f"friction {min(1.5 * high, 2.0):.3g}, half as much again as the most",
            (
                ("friction.finger_part_max", repr(min(1.5 * high, 2.0))),
                ("friction.finger_part_min", repr(min(1.5 * high, 2.0))),
            ),
        ),
        (
            f"encoder noise {2 * noise:g} mm, twice as much",
            (("gripper.encoder_noise_mm", repr(2.0 * noise)),),
        ),
        (
            f"the upper finger makes {100 * share:.3g} % of the way",
            (("gripper.upper_finger_share", repr(share)),),
        ),
        (
            "parts shift by 0.5 mm and 1 degree when let go",
            (("release.shift_mm", "0.5"), ("release.turn_deg", "1.0")),
        ),
    ]
    if job.pressure.kind in ("boundary", "uniform"):
        other = "uniform" if job.pressure.kind == "boundary" else "boundary"
        found.append((f"pressure {other}, not {job.pressure.kind}", (("pressure.kind", other),)))
    if job.actions.openings_mm:  # such a job needs fingers that move alike
        found = [change for change in found if "upper finger" not in change[0]]
    return found


def sensitivity(table: Table, job: Job, trials: int, seed: int) -> list[Finding]:
    """Runs a table in each of these worlds.

    Args:
        table: any.
        job: the job it was compiled from.
        trials: number of parts in each world.
        seed: of all of them.
    """
    return [_finding(table, job, world, trials, seed) for world in changes(job)]


def _finding(table: Table, job: Job, change: Change, trials: int, seed: int) -> Finding:
    name, overrides = change
    other = job_with(job.canonical(), overrides)
    evaluation = evaluate(table, other, make(other, seed), trials, seed)
    successes = int(evaluation.success.sum())
    figures = evaluation.summary()
    return Finding(
        name, successes / trials, *wilson_interval(successes, trials),
        figures["reject_rate"], figures["wrong_rate"], figures["mean_squeezes"],
    )  # fmt: skip
