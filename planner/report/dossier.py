"""A table as one page of HTML: its quality, the tree to walk through, and its job.

The page loads nothing from elsewhere; its Content-Security-Policy enforces this. The same table and seed give
the same bytes.
"""

import hashlib
import json
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from planner.arrays import Array
from planner.bound.certificate import Certificate
from planner.evaluation.evaluate import evaluate
from planner.evaluation.foreign import OFTEN, tried
from planner.evaluation.leaves import identities
from planner.evaluation.outcome import Evaluation
from planner.evaluation.shares import in_percent, shares_of
from planner.evaluation.trials import placement_of
from planner.job import hypotheses
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.part import outline as outlines
from planner.report import canvas, leaf_poses, look, tree, worlds
from planner.report import verdict as verdicts
from planner.report.branches import Tree, span_of, tree_of
from planner.report.canvas import asset, template
from planner.report.comparison import Comparison
from planner.report.replay import Replay, replay
from planner.report.run_log import PartLog, RunLog
from planner.report.verdict import cell_result, reject_text
from planner.world import make, supply, world_of
from runtime.pages import charts, frame
from runtime.table import Table

TRIALS = 4000
SENSITIVITY_TRIALS = 2000
OTHER_TRIALS = 300  # trials in another world, which may be slow
REJECTS = 100  # most rejects with a picture, the latest
LISTED = 5000  # most parts of a journal on the page: failed ones first, then the latest
GRADES = {"good": "Good:", "fair": "With a weakness:", "poor": "Not good enough:"}


class Source(NamedTuple):
    """Further input of a page, besides the table and its job."""

    name: str  # name of the table's file
    data: bytes  # content of the table's file
    log: RunLog | None = None  # a journal of the table
    bound: Certificate | None = None  # lower bound on squeezes
    takt_s: float | None = None  # time within which a part should be done
    compared: Comparison | None = None  # comparison with another plan, or with another run


class Reject(NamedTuple):
    """Picture of a rejected reading: the fingers at its width, and the replayed part nearest in width."""

    caption: str
    belief: Array  # (m, 3 or 4) possible states of the part when the hand arrives
    fingers: Array  # (2, 4, 2) corners of the fingers [mm]
    part: Array | None  # (3 or 4,) replayed state of the nearest width; None without one
    reach: float  # half the side of the picture [mm]


def page(
    table: Table,
    job: Job,
    source: Source,
    trials: int = TRIALS,
    seed: int = 0,
    world: str | None = None,
    *,
    sheet: bool = False,
) -> str:
    """The text of the page for a table and its job.

    Args:
        table: the table.
        job: the job of the table.
        source: further input.
        trials: number of replayed parts, whose poses are drawn as beliefs. The other worlds are tried with as
            many parts each, or with fewer.
        seed: seed of the replay, of the foreign parts and of the second world.
        world: "module:factory" of a second world in which the table is evaluated, if any.
        sheet: whether the page is a short version for a customer, on two sheets of paper.

    Raises:
        UsageError: the world does not exist.
    """
    beliefs = replay(table, job, trials, seed)
    branches = tree_of(table, job, beliefs, source.log)
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
    body = template("report.html").render(
        table=table,
        job=job,
        source=source,
        sheet=sheet,
        tree=branches,
        look=look.scenes(table, job, beliefs, look.SQUEEZES),
        where=verdicts.belief(job),
        trials=trials,
        seed=seed,
        summary=summary,
        shares=_shown(summary),
        worst=verdicts.weakest(lines),
        widths=[(alone.part.name, Markup(_width_chart(alone))) for alone in job.alone],
        verdict=verdicts.verdict(job, summary, lines),
        grades=GRADES,
        means=leaf_poses.means(table, judged),
        cell=cell_result(table, source.log) if source.log else None,
        few=few,
        rejects=_rejects(table, job, source.log, beliefs, branches.reach) if source.log else [],
        measured=source.log.times(source.takt_s) if source.log else {},
        worlds=rows,
        sha256=hashlib.sha256(source.data).hexdigest(),
        job_text=_job_text(job),
        outlines=[alone.part.outline_mm for alone in job.alone],
        named=tree.names_parts(table),
        posed=table.goal.kind != "identity",
        foreign=list(tried(table, job, judged, job.foreign_parts, evaluated)),
        often=OFTEN,
    )
    title = f"{job.name}: decision table {source.name}"
    style, script = asset("report.css"), frame.asset("tree.js") + asset("report.js")
    if sheet:
        return frame.page(title, body, style=style, kind="sheet")
    data = _data(table, branches, source.log)
    style += frame.asset("tree.css")
    return frame.page(title, body, style=style, data=data, script=script)


def _data(table: Table, branches: Tree, log: RunLog | None) -> dict[str, Any]:
    """Data for the page's script: at each node, which width leads where; and the parts of the journal."""
    nodes = {
        place.panel.key: {
            "span_mm": dict(zip(("low", "high"), span_of(place.ways), strict=True)),
            "ways": [{"low_mm": w.low_mm, "high_mm": w.high_mm, "to": w.key} for w in place.ways],
        }
        for place in branches.places
        if place.ways
    }
    return {"nodes": nodes, "parts": _parts(table, log) if log else None}


def _row(name: str, figures: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Returns the name of a world and its figures for the page; the key `shares` has the shares as texts."""
    return name, {**figures, "shares": _shown(figures)}


def _shown(figures: dict[str, Any]) -> dict[str, str]:
    return {name: in_percent(share) for name, share in shares_of(figures)._asdict().items()}


def _width_chart(job: Job) -> str:
    """HTML: chart of the width of a part's outline against the angle, and the angles of its minima."""
    angles = range(181)
    widths = [outlines.width(job.part.outline_mm, float(np.radians(angle))) for angle in angles]
    closed = widths[:-1]  # 180 degrees is 0 degrees again
    around = zip(np.roll(closed, 1), closed, np.roll(closed, -1), strict=True)
    lowest = [a for a, (before, width, after) in enumerate(around) if before > width <= after]
    minima = [f"{closed[a]:.2f} mm at {a}°" for a in lowest]
    label = "Width [mm] against the angle it is seen along"
    chart = charts.trend(label, [charts.Line("width", widths)], (), "degrees, 0 to")
    rest = f"<p>It comes to rest between the fingers at {', '.join(minima[:8])}.</p>"
    return chart + (rest if minima else "")


def _job_text(job: Job) -> str:
    """The job as text for people, one key with its value a line."""
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
    """A section of the job's text, followed by its subsections."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict)}
    values = (f"{key} = {json.dumps(value)}" for key, value in table.items() if key not in inner)
    below = [line for key, value in inner.items() for line in _section(f"{name}.{key}", value)]
    return ["", head.format(name), *values, *below]


def _parts(table: Table, log: RunLog) -> list[dict[str, Any]]:
    """Returns at most `LISTED` parts of a journal for the page, in the order of the journal.

    The latest failed parts are taken and, while there is room, the latest of the other parts.
    """
    failed = [number for number, part in enumerate(log.parts) if part.failed][-LISTED:]
    rest = [number for number, part in enumerate(log.parts) if not part.failed]
    shown = sorted(failed + rest[len(rest) - min(len(rest), LISTED - len(failed)) :])
    return [_part(table, log.parts[number]) for number in shown]


def _part(table: Table, part: PartLog) -> dict[str, Any]:
    squeezes = [
        {
            "node": tree.key_of(each.node),
            "width_mm": round(each.width_um / 1e3, 2),
            "to": None if each.target is None else tree.key_of(each.target),
        }
        for each in part.squeezes
    ]
    return {
        "part": part.part,
        "outcome": part.outcome,
        "name": part.name if tree.names_parts(table) else None,
        "reason": part.reason,
        "audit": part.audit,
        "failed": part.failed,
        "squeezes": squeezes,
    }


def _rejects(table: Table, job: Job, log: RunLog, beliefs: Replay, reach: float) -> list[Reject]:
    """Pictures of the latest rejected readings of a journal, at most `REJECTS`."""
    jaws, result = jaws_of(job.gripper), []
    for part, squeeze in log.rejects()[-REJECTS:]:
        node, width_mm = squeeze.node, squeeze.width_um / 1e3
        visit = beliefs.visits[node]
        hand = placement_of(table.nodes[node].squeeze)
        boxes = canvas.placed(canvas.finger_boxes(jaws, width_mm), hand)
        states, pose = beliefs.arrivals[node], None
        if len(visit.width_mm):
            nearest = int(np.argmin(np.abs(visit.width_mm - width_mm)))
            pose = np.append(visit.after[nearest], states[nearest, 3:])
        caption = f"Part {part.part}, node {node}: {reject_text(table, node, squeeze.width_um)}"
        shown = max(reach, 1.03 * float(np.abs(boxes).max()))
        result.append(Reject(caption, states, boxes, pose, shown))
    return result
