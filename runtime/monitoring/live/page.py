"""The live page, which follows a run: the operator's view, and on demand the tree of the table.

The page contains all but the run's status, which it requests from its server again and again. Its pictures
show the part's outline if the table carries its job.
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
    """Names and outlines of a table's parts, as the job in the table states them."""

    name: str  # the names joined by "or"; "Decision table" if unknown
    outlines: list[list[list[float]]]  # outline (n, 2) of each part [mm]; empty if unknown


def pages(table: Table, name: str, status: Status) -> Pages:
    """Builds the pages that a run's server offers.

    These are the live page, the HTML that the page fetches again and again, the status and the metrics.

    Args:
        table: the table.
        name: name of the table's file.
        status: status of the run.

    Returns:
        For each URL path, the media type, and a function that returns the content.
    """
    # The live page is built once, before anything moves.
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
    """Builds the HTML of the live page.

    Args:
        table: the table that the run executes.
        name: name of the table's file.
    """
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
    """Builds the data from which the page's script draws the tree: nodes, branches, leaves and outlines.

    Args:
        table: the table; its values are passed on in the table's units.
        outlines: outlines of the table's parts, mm.
    """
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
    """Returns a list of the rows' values for each name; in JSON, such columns are shorter than the rows."""
    return {name: [row[name] for row in rows] for name in names}


def parts(table: Table) -> Parts:
    """Reads names and outlines of a table's parts from the job in the table.

    They are unknown if the table has no job, or if the job has another format.
    """
    try:
        listed = [entry["part"] for entry in parts_of(job_of(table) or {})]
        outlines = [[[float(x), float(y)] for x, y in part["outline_mm"]] for part in listed]
        names = [str(part["name"]) for part in listed]
    except (ExpectedError, ValueError, TypeError, KeyError):
        names, outlines = [], []
    known = len(outlines) == max(1, len(table.hypotheses))
    return Parts(" or ".join(names) or "Decision table", outlines if known else [])
