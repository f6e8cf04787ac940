"""Many outlines, planned and judged: what each came to."""

import time
from typing import Any, NamedTuple

import numpy as np

from planner.compile import compile_job
from planner.diagnosis import reasons
from planner.diagnosis.advice import advise
from planner.errors import FitError, NoPlanError
from planner.job import model as job_file
from planner.part import symmetry
from planner.part.outline import canonical, reach
from planner.search.ranking import LEAST_CLEARANCE_MM
from planner.work.limit import Limit
from runtime.shell.errors import InputError, UnreachableError

LOCATED = 0.99  # least share of parts located for an outline to count
FITTING = 0.8  # radius of the disc, as a share of the room between the open fingers
MOST_MM = 10.0  # greatest radius of the disc
LEAST_MM = 1.0  # least radius
LONGEST_NAME = 80  # of a part in a job
ERROR = "error of the program"
Figures = dict[str, Any]


class Item(NamedTuple):
    """An outline to plan, fit to be sent to another machine."""

    name: str  # key
    outline_mm: list[list[float]]  # (N, 2)
    base: str  # canonical text of the job with gripper, friction and goal
    budget_s: float  # of planning, processor time


def judge(item: Item) -> Figures:
    """Plans an outline and evaluates its table; raises only where the cluster is lost."""
    started = time.thread_time(), time.perf_counter()
    figures: Figures = {
        "name": item.name,
        "outline_mm": item.outline_mm,
        "budget_s": item.budget_s,
        "cut": False,
    }
    try:
        figures |= _judged(item)
    except UnreachableError:
        raise
    except InputError as error:
        kind = reasons.TOO_LARGE if isinstance(error, FitError) else ERROR
        figures |= {"kind": kind, "text": str(error)}
    except Exception as error:  # on any error the others continue
        figures |= {"kind": ERROR, "text": f"{type(error).__name__}: {error}"}
    cpu, wall = time.thread_time() - started[0], time.perf_counter() - started[1]
    return figures | {"cpu_s": round(cpu, 2), "seconds": round(wall, 2)}


def _judged(item: Item) -> Figures:
    base = job_file.from_canonical(item.base)
    room = 0.5 * base.gripper.opening_mm - reach(np.array(item.outline_mm))
    radius_mm = min(MOST_MM, FITTING * room, room - LEAST_CLEARANCE_MM)
    if radius_mm < LEAST_MM:
        text = f"turned, it leaves {room:.1f} mm to the open fingers"
        return {"kind": reasons.TOO_LARGE, "text": text}
    order = symmetry.order(canonical(item.outline_mm).outline_mm)
    job = base.replaced(
        item.name,
        part={"name": item.name[-LONGEST_NAME:], "outline_mm": item.outline_mm, "symmetry": order},
        uncertainty={"radius_mm": radius_mm},
    )
    figures = {"symmetry": job.part.symmetry, "radius_mm": job.uncertainty.radius_mm}
    limit = Limit(item.budget_s, time.thread_time)  # not affected by other work on the machine
    try:
        plan = compile_job(job, workers=1, limit=limit)
    except NoPlanError as error:
        return figures | {"cut": error.cut_short} | reasons.no_plan(job, error)._asdict()
    summary = plan.evaluation.summary()
    for key in (
        "success_rate",
        "wrong_rate",
        "reject_rate",
        "unresolved_rate",
        "mean_squeezes",
        "seconds_mean",
        "error_mm",
        "crashes",
    ):
        figures[key] = summary[key]
    figures |= {"nodes": len(plan.table.nodes), "cut": plan.cut is not None}
    if summary["success_rate"] >= LOCATED:
        return figures | {"kind": None, "text": ""}
    advice = advise(plan.table, plan.evaluation, job)
    return figures | reasons.reason(job, advice, plan.cut is not None)._asdict()
