"""Worlds that are not what the plan believes: a standard set, the same for every part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.evaluation.disturbance import NONE, Disturbance
from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.job.overrides import job_with
from planner.part.outline import convex_hull, min_width
from planner.work.scheduler import Scheduler
from planner.world import World, Worlds
from runtime.table import Table


class Case(NamedTuple):
    """One world.

    Attributes:
        name: what is different.
        overrides: of the job that the world gets, names and values as in a job file.
        disturbance: errors of the cell.
    """

    name: str
    overrides: tuple[tuple[str, str], ...] = ()
    disturbance: Disturbance = NONE


class Line(NamedTuple):
    """What came of one case."""

    case: Case
    evaluation: Evaluation


def standard_cases(job: Job) -> list[Case]:
    """The standard set: pressure, friction, encoder, finger asymmetry, placement; first of all none of it."""
    cases = [Case("as planned")]
    for kind in ("boundary", "uniform"):
        if job.pressure.kind != kind:
            cases.append(Case(f"pressure {kind}", (("pressure.kind", kind),)))
    cases.append(on_three_feet(job))
    cases += [friction(low, high) for low, high in ((0.15, 0.25), (0.2, 0.3), (0.6, 0.8))]
    cases += [
        Case(f"encoder {offset:+g} mm", disturbance=Disturbance(encoder_offset_mm=offset))
        for offset in (-1.0, -0.4, 0.4, 1.0)
    ]
    noise = 3.0 * job.gripper.encoder_noise_mm
    cases.append(Case("encoder noise x 3", (("gripper.encoder_noise_mm", repr(noise)),)))
    cases += [uneven(job, share, centred=False) for share in (0.49, 0.51)]
    cases += [uneven(job, share, centred=True) for share in (0.4, 0.6)]
    return [
        *cases,
        Case("placement 0.5 mm, 0.5 deg", disturbance=Disturbance(placement_mm=0.5, placement_deg=0.5)),
        Case("arm off by 0.7 mm, 0.5 deg", disturbance=Disturbance(bias_mm=(0.5, 0.5), bias_deg=0.5)),
    ]


def three_feet(outline: Array) -> Array:
    """Three corners (3, 2) of the hull that span the largest triangle: as lopsided as a part stands."""
    hull = convex_hull(outline)
    # Of a dense curve every few vertices will do.
    hull = hull[:: -(-len(hull) // 24)]
    return max(
        (hull[list(corners)] for corners in combinations(range(len(hull)), 3)),
        key=lambda p: abs(np.linalg.det(np.array([p[1] - p[0], p[2] - p[0]]))),
    )


def sweep(
    table: Table,
    job: Job,
    cases: list[Case],
    worlds: Callable[[Job], World | Worlds],
    trials: int,
    seed: int,
    scheduler: Scheduler | None = None,
) -> Iterator[Line]:
    """Evaluates a table in one case after another, with the same initial poses in all of them.

    Args:
        table: the table.
        job: the job it was compiled from.
        cases: what the world is like instead.
        worlds: makes worlds for a job.
        trials: number of parts for each case.
        seed: of the trials.
        scheduler: who runs them.
    """
    for case in cases:
        real = job_with(job.canonical(), case.overrides, f"the world with {case.name}")
        yield Line(case, evaluate(table, real, worlds(real), trials, seed, scheduler, case.disturbance))


def on_three_feet(job: Job) -> Case:
    """The part stands on three of its corners."""
    feet = np.round(three_feet(job.part.outline_mm), 6).tolist()
    return Case("pressure on 3 feet", (("pressure.kind", "points"), ("pressure.points_mm", str(feet))))


def friction(low: float, high: float) -> Case:
    """Finger and part rub otherwise than planned."""
    bounds = (("friction.finger_part_min", repr(low)), ("friction.finger_part_max", repr(high)))
    return Case(f"friction {low:g} to {high:g}", bounds)


def uneven(job: Job, share: float, centred: bool) -> Case:
    """Fingers that do not move alike.

    They meet off where the plan has them meet, by (planned share - share) (opening - width). No width tells
    of that: it is a fault of the cell's calibration, and every pose is off by it. Centred, the hand is
    calibrated where the fingers meet on the part's narrowest side, and what is left is how an uneven squeeze
    moves the part.

    Args:
        job: what is planned.
        share: of the closing motion that the upper finger makes instead.
        centred: whether the hand is calibrated so.
    """
    off = (job.gripper.upper_finger_share - share) * (job.gripper.opening_mm - min_width(job.part.outline_mm))
    overrides = (
        # A job that chooses openings insists on fingers that move alike; the world has no use for the choice.
        ("actions.openings_mm", "[]"),
        ("gripper.upper_finger_share", repr(share)),
    )
    name = f"upper finger moves {share:.0%}" + (", centred" if centred else "")
    return Case(name, overrides, Disturbance(across_mm=-off) if centred else NONE)
