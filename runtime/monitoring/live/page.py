"""The page that follows a run: the loaded table as a tree, the node under way marked in it.

Everything is in the file but the state, which it asks its own server for. Where the table carries its job,
the leaves show the part's outline.
"""

import json
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from runtime.monitoring.live.server import Pages
from runtime.monitoring.status import Status
from runtime.table import Table, job_of

TEMPLATES = Path(__file__).parent / "templates"
JSON = "application/json"
METRICS = "text/plain; version=0.0.4; charset=utf-8"


def pages(table: Table, name: str, status: Status) -> Pages:
    """What a server of one run tells, by path with its media type; `name` is that of the table's file."""
    html = page(table, name).encode()  # once, before anything moves

    def state() -> bytes:
        return json.dumps(status.as_object()).encode() + b"\n"

    return {
        "/": ("text/html; charset=utf-8", lambda: html),
        "/status.json": (JSON, state),
        "/metrics": (METRICS, lambda: status.as_metrics().encode()),
    }


def page(table: Table, name: str) -> str:
    """The page's text, for a table and the name of its file."""
    part, outline = _part(table)
    # Within a script element only "<" could end it.
    data = json.dumps(tree(table, outline), separators=(",", ":")).replace("<", "\\u003c")
    style, script, text = (
        (TEMPLATES / f"live.{kind}").read_text("utf-8") for kind in ("css", "js", "html")
    )
    return Template(text).substitute(
        part=escape(part), name=escape(name), data=data, style=style, script=script
    )  # what is filled in is not looked at again


def tree(table: Table, outline: list[list[float]]) -> dict[str, Any]:
    """A table for the page, in its own units, and the outline (n, 2) [mm] of its part, empty if not known."""
    return {
        "outline": outline,
        "opening": table.gripper.opening_um,
        "finger": [table.gripper.finger_length_um, table.gripper.finger_width_um],
        "nodes": [[*node.squeeze.commands, node.branches] for node in table.nodes],
        "leaves": [
            [
                leaf.x_um,
                leaf.y_um,
                leaf.theta_urad,
                leaf.success_ppm,
                leaf.trials,
                int(leaf.resolved),
            ]
            for leaf in table.leaves
        ],
    }


def _part(table: Table) -> tuple[str, list[list[float]]]:
    """The part's name and outline from the job within the table; a job of another make shows without them."""
    try:
        part = (job_of(table) or {})["part"]
        outline = [[float(x), float(y)] for x, y in part["outline_mm"]]
        return str(part["name"]), outline
    except (ValueError, TypeError, KeyError):
        return "Decision table", []
