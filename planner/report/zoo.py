"""Plans for many outlines: the result for each, and one page of them all."""

import math
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from planner.compile import compile_job
from planner.diagnosis import reasons
from planner.diagnosis.advice import advise
from planner.errors import FitError, NoPlanError
from planner.job import model as job_file
from planner.job.drafts import FITTING, MOST_RADIUS_MM
from planner.part import symmetry
from planner.part.outline import canonical, reach
from planner.report.canvas import asset, template
from planner.search.ranking import LEAST_CLEARANCE_MM
from planner.work.limit import Limit
from runtime.pages import frame
from runtime.shell.errors import InputError, UnreachableError

LOCATED = 0.99  # least share of parts located for an outline to count as located
LEAST_MM = 1.0  # least radius of the uncertainty; an outline that allows less is too large
LONGEST_NAME = 80  # most characters of a part's name in a job
ERROR = "error of the program"
RATES = ("success_rate", "wrong_rate", "reject_rate", "unresolved_rate")
# Figures of a plan that are kept.
KEPT = (*RATES, "mean_squeezes", "seconds_mean", "error_mm", "crashes")
Figures = dict[str, Any]


class Item(NamedTuple):
    """An outline to plan, with the rest of its job; it can be pickled and planned on another machine."""

    name: str  # key of the outline, unique
    outline_mm: list[list[float]]  # (N, 2)
    base: str  # canonical text of the job with gripper, friction and goal
    budget_s: float  # processor time for planning


def judge(item: Item) -> Figures:
    """Plans an outline and evaluates the resulting table; returns the figures.

    If there is no good plan, the figures say why: `kind` and `text` describe the reason or the error.

    Raises:
        UnreachableError: the cluster cannot be reached; all other errors are stated in the figures.
    """
    started = time.thread_time(), time.perf_counter()
    stated = item._asdict().items()
    figures: Figures = {key: value for key, value in stated if key != "base"} | {"cut": False}
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
    radius_mm = min(MOST_RADIUS_MM, FITTING * room, room - LEAST_CLEARANCE_MM)
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
    figures |= {key: summary[key] for key in KEPT}
    figures |= {"nodes": len(plan.table.nodes), "cut": plan.cut is not None}
    if summary["success_rate"] >= LOCATED:
        return figures | {"kind": None, "text": ""}
    advice = advise(plan.table, plan.evaluation, job)
    return figures | reasons.reason(job, advice, plan.cut is not None)._asdict()


def page(rows: Sequence[Figures]) -> str:
    """All outlines with their results, failures first, as self-contained HTML."""
    located = [row for row in rows if row["kind"] is None]
    kinds = Counter(row["kind"] for row in rows if row["kind"] is not None)
    graspable = [row for row in rows if row["kind"] not in (reasons.TOO_LARGE, reasons.BELOW)]
    shown = sorted(rows, key=lambda row: (row["kind"] is None, row["kind"] or "", row["name"]))
    body = template("zoo.html").render(
        rows=[(row, _thumbnail(row["outline_mm"])) for row in shown],
        located=len(located),
        graspable=len(graspable),
        kinds=kinds.most_common(),
        times=_quantiles(rows, "cpu_s"),
        squeezes=_quantiles(located, "mean_squeezes"),
        least=LOCATED,
    )
    return frame.page(f"{len(rows)} outlines, planned and judged", body, style=asset("zoo.css"))


def _quantiles(rows: Sequence[Figures], key: str) -> list[float]:
    """The median and the 90th percentile of the figure `key` of all rows; nan without data."""
    values = [row[key] for row in rows if key in row] or [math.nan]
    return [float(value) for value in np.quantile(values, (0.5, 0.9))]


def _thumbnail(outline: list[list[float]]) -> str:
    """The outline as points of an SVG that is 100 wide, y up."""
    shape = np.array(outline)
    scale = 90.0 / float(np.ptp(shape, axis=0).max())
    middle = 0.5 * (shape.max(0) + shape.min(0))
    return " ".join(f"{50 + scale * x:.1f},{50 - scale * y:.1f}" for x, y in shape - middle)
