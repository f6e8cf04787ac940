"""A table as one page of HTML: the tree to walk through, how good it is, what it was made from.

Nothing comes from elsewhere, and the page tells the browser so (Content-Security-Policy). The same table and
seed give the same bytes.
"""

import hashlib
import json
from collections import Counter
from typing import Any, NamedTuple, cast

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.bound.certificate import Certificate
from planner.evaluation.evaluate import evaluate
from planner.evaluation.expectation import bins_of
from planner.evaluation.foreign import OFTEN, tried
from planner.evaluation.leaves import identities
from planner.evaluation.outcome import Evaluation
from planner.evaluation.shares import in_percent, shares_of
from planner.job import hypotheses
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.part import outline as outlines
from planner.report import canvas, leaf_poses, tree, worlds
from planner.report import verdict as verdicts
from planner.report.canvas import points, template
from planner.report.replay import Replay, replay
from planner.report.run_log import PartLog, RunLog
from planner.report.verdict import cell_result, reject_text
from planner.world import make, supply, world_of
from runtime.table import (
    PPM,
    REJECT,
    Leaf,
    Table,
    decision_map,
    wilson_interval,
)

TRIALS = 4000
SENSITIVITY_TRIALS = 2000
OTHER_TRIALS = 300  # in a world from elsewhere, which may take its time
STRIPS = 400  # most nodes whose clusters are drawn on the page itself; the others' wait until they are chosen
MOST = 60  # most outlines of one belief
BUDGET = 30_000  # outlines of all beliefs together: at some 15 bytes each, half a MB
REJECTS = 100  # most rejects that a picture is drawn of, the latest
LISTED = 5000  # most parts of a journal on the page: those that failed first, then the latest


class Source(NamedTuple):
    """What a page is about: the table's file name and bytes, its journal, bound and takt, if any."""

    name: str
    data: bytes
    log: RunLog | None = None
    bound: Certificate | None = None
    takt_s: float | None = None


def page(
    table: Table,
    job: Job,
    source: Source,
    trials: int = TRIALS,
    seed: int = 0,
    world: str | None = None,
) -> str:
    """The page's text for a table and its job; beliefs and times are found with `trials` parts.

    A second world, "module:factory", judges the table too, with some parts.

    Raises:
        UsageError: there is no such world.
    """
    beliefs = replay(table, job, trials, seed)
    drawing = tree.drawing(table, job, beliefs)
    most = min(MOST, BUDGET // (len(table.nodes) + len(table.leaves)))
    nodes = _nodes(table, beliefs, most)
    data = {
        "outline": points(job.part.outline_mm),
        "datum": _datum(job),
        **(_several(table, job) if table.hypotheses else {}),
        "reach": round(drawing.reach, 2),
        "jaws": [round(float(value), 3) for value in jaws_of(job.gripper)],
        "trials": trials,
        "opening": table.gripper.opening_um,
        "bin": table.gripper.opening_um / table.gripper.bins,
        "nodes": nodes,
        "leaves": [
            _leaf(leaf, at, most) for leaf, at in zip(table.leaves, beliefs.leaves, strict=True)
        ],
        "log": _log(table, source.log) if source.log else None,
    }
    few = min(trials, SENSITIVITY_TRIALS)

    def evaluated(foreign: Job) -> Evaluation:
        return evaluate(table, foreign, world_of(foreign, seed, make), few, seed)

    judged = worlds.evaluation_of(table, job, trials)
    lines = worlds.tried(table, job, judged, few)
    rows = [_row(line.case.name, line.evaluation.summary()) for line in lines]
    if world is not None:
        other = evaluate(table, job, supply(world, job, seed), min(trials, OTHER_TRIALS), seed)
        rows.append(_row(f"{world}, {len(other.leaf)} parts", other.summary()))
    named = identities(table, judged).figures() if table.hypotheses else {}
    summary = judged.summary(source.takt_s) | named
    return template("report.html").render(
        table=table,
        job=job,
        source=source,
        drawing=drawing,
        data=data,
        trials=trials,
        seed=seed,
        summary=summary,
        shares=_shown(summary),
        worst=verdicts.weakest(lines),
        widths=[(alone.part.name, _width_function(alone)) for alone in job.alone],
        verdict=verdicts.verdict(job, summary, lines),
        means=leaf_poses.means(table, judged),
        cell=cell_result(table, source.log) if source.log else None,
        measured=source.log.times(source.takt_s) if source.log else {},
        strips=[node["map"] for node in nodes[:STRIPS]],
        worlds=rows,
        sha256=hashlib.sha256(source.data).hexdigest(),
        job_text=_job_text(job),
        colors=vars(canvas),
        outlines=[alone.part.outline_mm for alone in job.alone],
        named=tree.names_parts(table),
        posed=table.goal.kind != "identity",
        foreign=list(tried(table, job, judged, job.foreign_parts, evaluated)),
        often=OFTEN,
    )


def _several(table: Table, job: Job) -> dict[str, Any]:
    """The parts that may lie there, and what leaves say of them."""
    parts = zip(table.hypotheses, job.alone, strict=True)
    return {
        "parts": [{"name": hypothesis.name, "datum": _datum(alone)} for hypothesis, alone in parts],
        "which": [[pose.hypothesis for pose in leaf.poses] for leaf in table.leaves],
        "named": tree.names_parts(table),
        "posed": table.goal.kind != "identity",
    }


def _datum(job: Job) -> list[float] | None:
    return None if job.part.datum is None else cast(list[float], job.part.datum.tolist())


def _row(name: str, figures: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """A world, its figures, and its shares of all parts as they are printed."""
    return name, {**figures, "shares": _shown(figures)}


def _shown(figures: dict[str, Any]) -> dict[str, str]:
    return {name: in_percent(share) for name, share in shares_of(figures)._asdict().items()}


def _width_function(job: Job) -> dict[str, Any]:
    angles = range(181)
    widths = [outlines.width(job.part.outline_mm, float(np.radians(angle))) for angle in angles]
    top = 1.08 * max(widths)
    rows = [f"{3 * a} {140 - 130 * w / top:.1f}" for a, w in zip(angles, widths, strict=True)]
    closed = widths[:-1]  # 180 degrees is 0 degrees again
    minima = [
        (a, w) for a, w in enumerate(closed) if closed[a - 1] > w <= closed[(a + 1) % len(closed)]
    ]
    step = next(s for s in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0) if top / s <= 6)
    ticks = [(k * step, 140 - 130 * k * step / top) for k in range(int(top / step) + 1)]
    return {"path": "M" + "L".join(rows), "minima": minima, "ticks": ticks, "top": top}


def _job_text(job: Job) -> str:
    """The job, one value a line, the outline's rows as they are."""
    lines: list[str] = []
    for section, table in json.loads(job.canonical()).items():
        if section in (hypotheses.KEY, hypotheses.FOREIGN):
            lines += [line for entry in table or () for line in _section(section, entry, "[[{}]]")]
        elif isinstance(table, dict):
            lines += _section(section, table)
        else:
            lines.insert(0, f"{section} = {json.dumps(table)}")
    return "\n".join(lines)


def _section(name: str, table: dict[str, Any], head: str = "[{}]") -> list[str]:
    """A section of the job's text, then those within it."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict)}
    values = (f"{key} = {json.dumps(value)}" for key, value in table.items() if key not in inner)
    below = [line for key, value in inner.items() for line in _section(f"{name}.{key}", value)]
    return ["", head.format(name), *values, *below]


def _log(table: Table, log: RunLog) -> dict[str, Any]:
    def named(part: PartLog) -> list[str | None]:
        return [part.name] if tree.names_parts(table) else []

    failed = [number for number, part in enumerate(log.parts) if part.failed][-LISTED:]
    rest = [number for number, part in enumerate(log.parts) if not part.failed]
    shown = sorted(failed + rest[len(rest) - min(len(rest), LISTED - len(failed)) :])
    return {
        "runs": log.runs,
        "others": log.others,
        "first": log.first,
        "last": log.last,
        "total": len(log.parts),
        "outcomes": dict(log.outcomes().most_common()),
        "branches": [[node, target, n] for (node, target), n in log.branch_counts().items()],
        "parts": [
            [
                part.part,
                part.outcome,
                part.leaf,
                part.reason,
                part.audit,
                part.squeezes,
                *named(part),
            ]
            for part in (log.parts[number] for number in shown)
        ],
        "rejects": [
            [part.part, node, width_um, reject_text(table, node, width_um)]
            for part in log.parts
            for node, width_um, target in part.squeezes[-1:]
            if target is None
        ][-REJECTS:],
    }


def _nodes(table: Table, beliefs: Replay, most: int) -> list[dict[str, Any]]:
    """One object a node: its squeeze, branches, belief of at most so many outlines, widths of the replay.

    Poses are integers, hundredths of a mm and milliradians; widths are um, as in the table.
    """
    gripper, rows = table.gripper, []
    for node, visit, states in zip(table.nodes, beliefs.visits, beliefs.arrivals, strict=True):
        squeeze, taken = node.squeeze, Counter(visit.branch.tolist())
        seen = Counter(bins_of(table, visit.steps).tolist())
        rows.append(
            {
                "place": [squeeze.x_um, squeeze.y_um, squeeze.angle_urad],
                "opening": squeeze.opening_um,
                "speed": squeeze.speed_um_s,
                "force": squeeze.force_mn,
                "clearance": squeeze.clearance_um,
                "release": node.release,
                "pushes": node.pushes,
                "visits": len(visit.before),
                "belief": _poses(states, most),
                "branches": [
                    [*branch, taken[number]] for number, branch in enumerate(node.branches)
                ],
                "rejected": taken[REJECT],
                "map": decision_map(node, gripper).either.intervals(),
                "seen": [
                    (gripper.opening_um * number // gripper.bins, times)
                    for number, times in sorted(seen.items())
                ],
            }
        )
    return rows


def _leaf(leaf: Leaf, poses: Array, most: int) -> dict[str, Any]:
    """One object a leaf: its pose, what its trials showed, where its parts lay."""
    success = round(leaf.success_ppm * leaf.trials / PPM)
    return {
        "pose": [leaf.x_um, leaf.y_um, leaf.theta_urad],
        "covariance": leaf.covariance,
        "success": leaf.success_ppm,
        "interval": [round(bound, 5) for bound in wilson_interval(success, leaf.trials)],
        "trials": leaf.trials,
        "resolved": leaf.resolved,
        "alternatives": [[pose.x_um, pose.y_um, pose.theta_urad] for pose in leaf.alternatives],
        "visits": len(poses),
        "belief": _poses(poses, most),
    }


def _poses(states: Array, most: int) -> list[list[int]]:
    scaled = np.rint(subsample(states, most) * (100.0, 100.0, 1000.0, 1.0)[: states.shape[1]])
    return cast(list[list[int]], scaled.astype(np.int64).tolist())
