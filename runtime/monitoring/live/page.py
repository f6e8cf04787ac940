"""The page that follows a run: the operator's view, and on demand the tree of the table.

The page contains everything except the state, which it requests from its server. Pictures show the part's
outline where the table carries its job.
"""

import json
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from runtime.monitoring.live import operator
from runtime.monitoring.live.server import Pages
from runtime.monitoring.status import Status
from runtime.pages import frame
from runtime.shell.errors import ExpectedError
from runtime.table import Table, job_of
from runtime.table.embedded import parts_of

TEMPLATES = Path(__file__).parent / "templates"
HTML, JSON = "text/html; charset=utf-8", "application/json"
METRICS = "text/plain; version=0.0.4; charset=utf-8"


class Parts(NamedTuple):
    """Names and outlines of the parts of a table, from the job inside it."""

    name: str  # the names joined by "or"; "Decision table" if unknown
    outlines: list[list[list[float]]]  # outline (n, 2) of each part [mm]; empty if unknown


def pages(table: Table, name: str, status: Status) -> Pages:
    """Returns, by URL path, the media type of each page of a run and a function that returns its content.

    Args:
        table: the table.
        name: name of the table's file.
        status: status of the run.
    """
    # Built once, before anything moves.
    html, outlines = page(table, name).encode(), parts(table).outlines

    def screen() -> bytes:
        seen = status.as_object()
        below = operator.screen(table, outlines, seen)
        text = f'<div id="state" role="status">{operator.state(seen)}</div>\n<div id="screen">{below}</div>'
        status.watched.set()
        return text.encode()

    return {
        "/": (HTML, lambda: html),
        "/screen.html": (HTML, screen),
        "/status.json": (JSON, lambda: json.dumps(status.as_object()).encode() + b"\n"),
        "/metrics": (METRICS, lambda: status.as_metrics().encode()),
    }


def page(table: Table, name: str) -> str:
    """The page's text, for a table and the name of its file."""
    name_of_parts, outlines = parts(table)
    style, script, below = (
        (TEMPLATES / f"live.{kind}").read_text("utf-8") for kind in ("css", "js", "html")
    )
    head = f"<header><h1>{escape(name_of_parts)} <small>{escape(name)}</small></h1></header>"
    return frame.page(
        f"{name_of_parts}: live",
        f"{head}\n{below}",
        style=frame.asset("tree.css") + style,
        data=tree(table, outlines),
        script=frame.asset("tree.js") + script,
        policy="connect-src 'self'",
    )


def tree(table: Table, outlines: list[list[list[float]]]) -> dict[str, Any]:
    """Data for the page's script: columns of a table in the table's units, and the parts' outlines [mm]."""
    branches = [
        {"node": index, **branch._asdict()}
        for index, node in enumerate(table.nodes)
        for branch in node.branches
    ]
    squeezes = [node.squeeze._asdict() for node in table.nodes]
    leaves = [{**leaf._asdict(), "resolved": int(leaf.resolved)} for leaf in table.leaves]
    places = ("x_um", "y_um")
    return {
        "outlines": outlines,
        "names": [part.name for part in table.hypotheses if table.goal.identify],
        "posed": table.goal.kind != "identity",
        "opening_um": table.gripper.opening_um,
        "finger_length_um": table.gripper.finger_length_um,
        "finger_width_um": table.gripper.finger_width_um,
        "nodes": _columns(squeezes, *places, "angle_urad", "opening_um", "speed_um_s", "force_mn"),
        "branches": _columns(branches, "node", "low_um", "high_um", "probability_ppm", "target"),
        "leaves": _columns(
            leaves, *places, "theta_urad", "success_ppm", "trials", "resolved", "hypothesis"
        ),
    }


def _columns(rows: list[dict[str, Any]], *names: str) -> dict[str, list[Any]]:
    """Converts rows to one list for each name; as JSON this is shorter than names in every row."""
    return {name: [row[name] for row in rows] for name in names}


def parts(table: Table) -> Parts:
    """Names and outlines of a table's parts; unknown if the table has no job, or one of another format."""
    try:
        listed = [entry["part"] for entry in parts_of(job_of(table) or {})]
        outlines = [[[float(x), float(y)] for x, y in part["outline_mm"]] for part in listed]
        names = [str(part["name"]) for part in listed]
    except (ExpectedError, ValueError, TypeError, KeyError):
        names, outlines = [], []
    known = len(outlines) == max(1, len(table.hypotheses))
    return Parts(" or ".join(names) or "Decision table", outlines if known else [])
