"""The files of an export: a table's data and executor in one language, and the vectors that check them."""

import csv
import io
import json
import re
import textwrap
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from planner.export.content import VECTOR, drag_of, holds, maps_of, runs_of, vectors
from runtime.shell.files import OutputError, folder, writing
from runtime.table import Table, TableFile

FORMS = {
    "c99": ("squeezetree_table.h",),
    "st": ("squeezetree_table.st",),
    "json": ("squeezetree_table.json", "squeezetree_table.schema.json"),
}
VECTORS = "vectors.csv"
JSON_VERSION = 1  # as in the schema
WIDTH = 100  # of a line of numbers
OF_SEVERAL = ("identify", "hypothesis", "other_hypotheses")  # fields of goal and leaf
Row = tuple[int, ...]
UNKNOWN = -1  # success of a leaf without trials
LONGEST_TEXT = 60  # of the table's own, in comments


def write(found: TableFile, form: str, path: Path) -> dict[str, int]:
    """Write a table in one of `FORMS`, and its vectors, into a new or an empty folder.

    Returns:
        The bytes of each file, by name.

    Raises:
        OutputError: the folder holds files or cannot be written; nothing of the export is left there.
    """
    texts = {VECTORS: _csv(found.table)}
    texts |= {name: _text(name, found) for name in FORMS[form]}
    _check_empty(folder(path))
    written: list[Path] = []
    try:
        for name, text in texts.items():
            with writing(path / name) as draft:
                draft.write_text(text, encoding="ascii")
            written.append(path / name)
    except BaseException:
        for file in written:
            file.unlink(missing_ok=True)
        raise
    return {file.name: file.stat().st_size for file in written}


def _check_empty(path: Path) -> None:
    try:
        empty = not any(path.iterdir())
    except OSError as error:
        raise OutputError(f"{path} cannot be looked into: {error.strerror}; name another folder") from error
    if not empty:
        raise OutputError(f"{path} holds files already, which stay; name another folder, new or empty")


def _text(name: str, found: TableFile) -> str:
    if name == "squeezetree_table.json":
        return json.dumps(_document(found), indent=1) + "\n"
    return _templates().get_template(name).render(_values(found))


def _csv(table: Table) -> str:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(VECTOR)
    rows.writerows(vectors(table))
    return text.getvalue()


def _document(found: TableFile) -> dict[str, Any]:
    """All of a table as one JSON object but for the job, under the names of `TABLE.md`, with the runs."""
    table, maps = found.table, maps_of(found.table)
    return {
        "format": "squeezetree table",
        "version": JSON_VERSION,
        "table_sha256": found.digest,
        "tool": table.tool,
        "job_digest": table.job_digest.hex(),
        "gripper": asdict(table.gripper),
        "goal": _of_one_part(asdict(table.goal)),
        "limits": asdict(table.limits),
        "predicted": asdict(table.predicted),
        "nodes": [
            {
                **node.squeeze._asdict(),
                "release_um": drag_of(node),
                "branches": [branch._asdict() for branch in node.branches],
                "runs": [run._asdict() for run in runs_of(decided)],
            }
            for node, decided in zip(table.nodes, maps, strict=True)
        ],
        "leaves": [_of_one_part(leaf._asdict()) for leaf in table.leaves],
    }


def _of_one_part(record: dict[str, Any]) -> dict[str, Any]:
    """A record without what only tables for several parts say, which are not exported."""
    return {key: value for key, value in record.items() if key not in OF_SEVERAL}


def _values(found: TableFile) -> dict[str, Any]:
    """What the templates of programs fill in: names and columns of integers, all within 32 bits."""
    table = found.table
    nodes: list[Row] = []
    runs: list[Row] = []
    leaves: list[Row] = []
    alternatives: list[Row] = []
    for node, decided in zip(table.nodes, maps_of(table), strict=True):
        own = runs_of(decided)
        nodes.append((*node.squeeze[:6], *drag_of(node), len(runs), len(own)))
        for flag, first, last, branch in own:
            held, target = int(holds(node, branch)), node.branches[branch].target
            runs.append((flag, first, last, held, target))
    for leaf in table.leaves:
        success = leaf.success_ppm if leaf.trials else UNKNOWN
        others = len(alternatives), len(leaf.alternatives)
        leaves.append((*leaf[:3], success, leaf.error_p95_um, int(leaf.resolved), *others))
        alternatives += leaf.alternatives
    return {
        "tool": _plain(table.tool),
        "gripper": table.gripper,
        "model": _plain(table.gripper.model),
        "digest": found.digest,
        "limits": table.limits,
        "nodes": nodes,
        "runs": runs,
        "leaves": leaves,
        "alternatives": alternatives,
    }


def _plain(text: str) -> str:
    """A text of the table that can stand in a comment and cannot end it."""
    return re.sub(r"[^A-Za-z0-9 .,_+-]", "_", text[:LONGEST_TEXT])


@cache
def _templates() -> Environment:
    made = Environment(
        loader=PackageLoader("planner.export", "templates"), autoescape=False, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    made.filters["numbers"] = lambda row: ", ".join(map(str, row))
    made.filters["wrapped"] = lambda column: textwrap.fill(
        ", ".join(map(str, column)), WIDTH, initial_indent=" " * 8, subsequent_indent=" " * 8
    )
    return made
