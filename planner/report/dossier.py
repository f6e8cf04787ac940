"""A table as one page of HTML: the tree to walk through, how good it is, what it was made from.

Everything is in the file: no script, style, font or picture comes from elsewhere, and the page says so to the
browser (Content-Security-Policy). What it shows is found by sending parts through the table, seeded: the same
table and seed give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.bound.certificate import Certificate
from planner.evaluation.cases import assumption_cases
from planner.evaluation.evaluate import evaluate, sweep
from planner.evaluation.statistics import wilson_interval
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.part import outline as outlines
from planner.report import canvas, tree
from planner.report.details import leaf_details, node_details, runs
from planner.report.models import Models
from planner.report.replay import replay
from planner.report.run_log import PartLog, RunLog
from planner.report.templating import template
from planner.world import make
from runtime.table import PPM, REJECT, Calibration, Table, by_count, decision_map

TRIALS = 4000
SENSITIVITY_TRIALS = 2000
STRIPS = 400
"""Most nodes whose clusters are drawn on the page itself; the others' are drawn when they are chosen."""
LISTED = 5000
"""Most parts of a journal that the page lets one walk through: all that failed first, then the latest."""


@dataclass(frozen=True, slots=True)
class Source:
    """What a page is about: the table's file name and bytes, its journal, models and bound, if any."""

    name: str
    data: bytes
    log: RunLog | None = None
    models: Models | None = None
    bound: Certificate | None = None


def page(table: Table, job: Job, source: Source, trials: int = TRIALS, seed: int = 0) -> str:
    """The page's text.

    Args:
        table: as loaded.
        job: the job it was compiled from.
        source: the file it came from.
        trials: parts sent through the table, to find the beliefs and the times.
        seed: of these.
    """
    beliefs = replay(table, job, trials, seed)
    drawing = tree.drawing(table, job, beliefs)
    data = {
        "outline": tree.points(job.part.outline_mm),
        "reach": round(drawing.reach, 2),
        "jaws": [round(float(value), 3) for value in jaws_of(job.gripper)],
        "trials": trials,
        "counts": [table.gripper.count_open, table.gripper.count_closed, table.gripper.opening_um],
        "nodes": node_details(table, beliefs),
        "leaves": leaf_details(table, beliefs),
        "log": _log(source.log) if source.log else None,
    }
    few = min(trials, SENSITIVITY_TRIALS)
    others = sweep(table, job, assumption_cases(job), lambda real: make(real, seed), few, seed)
    evaluation = evaluate(table, job, make(job, seed), trials, seed).summary()
    return template("report.html").render(
        table=table, job=job, source=source, drawing=drawing, data=data, trials=trials, seed=seed,
        summary=_summary(table, evaluation), widths=_width_function(job), strips=_strips(table),
        worlds=[(line.case.name, line.evaluation.summary()) for line in others],
        sha256=hashlib.sha256(source.data).hexdigest(), job_text=_job_text(job), colors=vars(canvas),
    )  # fmt: skip


def _summary(table: Table, evaluation: dict[str, Any]) -> dict[str, Any]:
    """The figures on top: the compiler's own where it measured some, else the replay's."""
    predicted = table.predicted
    trials = predicted.trials
    success = predicted.success_ppm / PPM if trials else evaluation["success_rate"]
    trials = trials or evaluation["trials"]
    return {
        "success": success,
        "interval": wilson_interval(round(success * trials), trials),
        "trials": trials,
        "rejected": predicted.reject_ppm / PPM if predicted.trials else evaluation["reject_rate"],
        "squeezes": predicted.mean_squeezes_ppm / PPM if predicted.trials else evaluation["mean_squeezes"],
        "again": evaluation,
    }


def _width_function(job: Job) -> dict[str, Any]:
    """The extent of the part against its angle: (n, 2) points [deg, mm], as a path, and its minima."""
    angles = np.arange(0.0, 180.5, 1.0)
    widths = [outlines.width(job.part.outline_mm, float(np.radians(angle))) for angle in angles]
    top = 1.08 * max(widths)
    rows = [f"{3 * a:.0f} {140 - 130 * w / top:.1f}" for a, w in zip(angles, widths, strict=True)]
    closed = widths[:-1]  # 180 degrees is 0 degrees again
    minima = [
        (float(angles[k]), closed[k])
        for k in range(len(closed))
        if closed[k - 1] > closed[k] <= closed[(k + 1) % len(closed)]
    ]
    ticks = [(value, 140 - 130 * value / top) for value in _ticks(top)]
    return {"path": "M" + "L".join(rows), "minima": minima, "ticks": ticks, "top": top}


def _ticks(top: float) -> list[float]:
    """Round values from 0 to a length, three to six of them."""
    step = next(s for s in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0) if top / s <= 6)
    return [k * step for k in range(int(top / step) + 1)]


def _strips(table: Table) -> list[Any]:
    """For each node, its counts of one meaning."""
    calibration = Calibration.linear(table.gripper)
    return [
        [run for run in runs(by_count(decision_map(node, calibration))) if run.branch != REJECT]
        for node in table.nodes[:STRIPS]
    ]


def _job_text(job: Job) -> str:
    """The job, one value a line, the outline's rows as they are."""
    lines: list[str] = []
    for section, table in json.loads(job.canonical()).items():
        if not isinstance(table, dict):
            lines.insert(0, f"{section} = {json.dumps(table)}")
            continue
        lines += ["", f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in table.items())]
    return "\n".join(lines)


def _log(log: RunLog) -> dict[str, Any]:
    """A journal for the page."""
    shown = sorted(_listed(log.parts), key=lambda entry: entry[0])
    return {
        "runs": log.runs,
        "others": log.others,
        "first": log.first,
        "last": log.last,
        "total": len(log.parts),
        "outcomes": dict(log.outcomes().most_common()),
        "branches": [[node, target, n] for (node, target), n in log.branch_counts().items()],
        "parts": [
            [part.part, part.outcome, part.leaf, part.reason, part.audit,
             [[step.node, step.reading, step.target] for step in part.squeezes]]
            for _, part in shown
        ],
    }  # fmt: skip


def _listed(parts: list[PartLog]) -> list[tuple[int, PartLog]]:
    numbered = list(enumerate(parts))
    failed = [entry for entry in numbered if entry[1].failed][-LISTED:]
    rest = [entry for entry in numbered if not entry[1].failed]
    room = LISTED - len(failed)
    return failed + (rest[-room:] if room else [])
