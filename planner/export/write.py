"""Writes an export: a table's data and executor in one language, with vectors that test them.

Every language stores the branches of a node as runs, which are intervals of widths.
"""

import json
import re
import textwrap
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment

from planner.templating import environment
from runtime import table as tables
from runtime.shell.files import OutputError, folder
from runtime.shell.files import write as write_text
from runtime.table import HELD_UM, REJECT

# The object flag (gOBJ) of jaws that met something, and of jaws that met nothing.
FELT, NOT_FELT = 2, 3
NODE, LEAF, UNRESOLVED, REJECTED, FAULT = range(5)  # outcome of a reading, in vectors and programs
VECTOR = ("node", "width_um", "object_flag", "outcome", "index", "release_x_um", "release_y_um")


class Run(NamedTuple):
    """An interval of widths at a node that leads to one branch; widths in no run are rejected."""

    object_flag: int  # FELT or NOT_FELT
    first_um: int  # least width
    last_um: int  # greatest width, inclusive
    branch: int  # index into the node's branches


def maps_of(table: tables.Table) -> list[tables.DecisionMap]:
    """Returns the decision map of each node of a table."""
    return [tables.decision_map(node, table.gripper) for node in table.nodes]


def runs_of(decided: tables.DecisionMap) -> list[Run]:
    """The runs of a decision map by ascending width; the runs for readings with an object come first."""
    return [
        Run(flag, *interval)
        for flag, segments in ((FELT, decided.felt), (NOT_FELT, decided.unfelt))
        for interval in segments.intervals()
    ]


def holds(node: tables.Node, branch: int) -> bool:
    """Whether the jaws hold the part after a branch; False for REJECT, after which they may hold anything."""
    return branch != REJECT and node.branches[branch].expected_um >= HELD_UM


def vectors(table: tables.Table) -> Iterator[tuple[int, ...]]:
    """Yields test vectors as rows of the columns `VECTOR`.

    A vector states a node, a width and an object flag, and what follows: outcome, target and the place where
    the hand lets go. The widths are those that `_compared` lists.
    """
    for index, (node, decided) in enumerate(zip(table.nodes, maps_of(table), strict=True)):
        for flag, segments in ((FELT, decided.felt), (NOT_FELT, decided.unfelt)):
            for width_um in _compared(segments, table.gripper.opening_um):
                branch = segments.at(width_um)
                place = node.let_go if holds(node, branch) else node.squeeze.place
                yield index, width_um, flag, *_next(table, node, branch), *place


def _compared(segments: tables.Segments, opening_um: int) -> list[int]:
    """Widths at which segments are tested [um].

    These are both ends and the middle of each segment, the opening, and -1, a width that is always rejected.
    """
    widths = {-1, opening_um}
    for low, high in pairwise((*segments.starts_um, max(opening_um, segments.starts_um[-1]) + 1)):
        widths |= {low, (low + high - 1) // 2, high - 1}
    return sorted(widths)


def _next(table: tables.Table, node: tables.Node, branch: int) -> tuple[int, int]:
    """What follows a branch: the outcome, and the index of the next node or leaf, which is -1 for REJECT."""
    if branch == REJECT:
        return REJECTED, -1
    target = node.branches[branch].target
    if target >= 0:
        return NODE, target
    return (LEAF if table.leaves[~target].resolved else UNRESOLVED), ~target


FORMS = {
    "c99": ("squeezetree_table.h",),
    "st": ("squeezetree_table.st",),
    "json": ("squeezetree_table.json", "squeezetree_table.schema.json"),
}
VECTORS = "vectors.csv"
PREFIX = "squeezetree"
PREFIXES = re.compile(r"(?=.{1,24}$)[a-z][a-z0-9]*(_[a-z0-9]+)*")
"""Valid prefixes: names stay within 63 characters (C99), and underscores are single (IEC 61131-3)."""
JSON_VERSION = 2  # version of the JSON form, as in its schema
WIDTH = 100  # columns of a line of numbers
OF_SEVERAL = ("identify", "hypothesis")  # fields of goal and leaf that are not exported
Row = tuple[int, ...]
UNKNOWN = -1  # success of a leaf without trials
LONGEST_TEXT = 60  # most characters of a text of the table in a comment


def write(file: tables.TableFile, form: str, path: Path, prefix: str = PREFIX) -> dict[str, int]:
    """Writes a table in one of `FORMS`, and its vectors, into a new or an empty folder.

    Args:
        file: the table.
        form: one of `FORMS`.
        path: the folder.
        prefix: prefix of the names of all files except `VECTORS`, and of all names that a program defines.

    Returns:
        The size of each file [bytes], by name.

    Raises:
        OutputError: the folder holds files or cannot be written; no file of the export remains.
    """
    rows = (VECTOR, *vectors(file.table))
    texts = {VECTORS: "".join(",".join(map(str, row)) + "\n" for row in rows)}
    texts |= {name.replace(PREFIX, prefix): _text(name, file, prefix) for name in FORMS[form]}
    try:
        new = [place for place in (path, *path.parents) if not place.exists()]
    except OSError as error:  # a name that is too long
        problem = f"cannot be created: {error.strerror}; name another folder"
        raise OutputError(f"{path} {problem}") from error
    folder(path)
    try:
        empty = not any(path.iterdir())
    except OSError as error:
        problem = f"cannot be looked into: {error.strerror}; name another folder"
        raise OutputError(f"{path} {problem}") from error
    if not empty:
        problem = "holds files already, which stay; name another folder, new or empty"
        raise OutputError(f"{path} {problem}")
    written: list[Path] = []
    try:
        for name, text in texts.items():
            write_text(path / name, text)
            written.append(path / name)
    except BaseException:
        for place in written:
            place.unlink(missing_ok=True)
        with suppress(OSError):
            for parent in new:
                parent.rmdir()
        raise
    return {place.name: place.stat().st_size for place in written}


def _text(name: str, file: tables.TableFile, prefix: str) -> str:
    if name == "squeezetree_table.json":
        return json.dumps(_document(file), indent=1) + "\n"
    return _templates().get_template(name).render(_values(file), prefix=prefix)


def _document(file: tables.TableFile) -> dict[str, Any]:
    """A table as one JSON object with the field names of `TABLE.md`, with the runs and without the job."""
    table, maps = file.table, maps_of(file.table)
    return {
        "format": "squeezetree table",
        "version": JSON_VERSION,
        "table_sha256": file.digest,
        "tool": table.tool,
        "job_digest": table.job_digest.hex(),
        "gripper": asdict(table.gripper),
        "goal": _of_one_part(asdict(table.goal)),
        "limits": asdict(table.limits),
        "predicted": asdict(table.predicted),
        "nodes": [
            {
                **node.squeeze._asdict(),
                "release_um": node.let_go,
                "branches": [branch._asdict() for branch in node.branches],
                "runs": [run._asdict() for run in runs_of(decided)],
            }
            for node, decided in zip(table.nodes, maps, strict=True)
        ],
        "leaves": [
            _of_one_part({**leaf._asdict(), "alternatives": [*map(_pose, leaf.alternatives)]})
            for leaf in table.leaves
        ],
    }


def _of_one_part(record: dict[str, Any]) -> dict[str, Any]:
    """Returns a copy of a record without the fields `OF_SEVERAL`, which matter only for several parts."""
    return {key: value for key, value in record.items() if key not in OF_SEVERAL}


def _pose(pose: tables.Leaf | tables.LeafPose) -> tuple[int, int, int]:
    return pose.x_um, pose.y_um, pose.theta_urad


def _values(file: tables.TableFile) -> dict[str, Any]:
    """Values for the templates of programs: names, and columns of integers within 32 bits."""
    table = file.table
    nodes, runs, leaves, alternatives = list[Row](), list[Row](), list[Row](), list[Row]()
    for node, decided in zip(table.nodes, maps_of(table), strict=True):
        intervals = runs_of(decided)
        nodes.append((*node.squeeze.commands, *node.let_go, len(runs), len(intervals)))
        for flag, first, last, branch in intervals:
            held, target = int(holds(node, branch)), node.branches[branch].target
            runs.append((first, last, target, flag, held))
    for leaf in table.leaves:
        success = leaf.success_ppm if leaf.trials else UNKNOWN
        others = len(alternatives), len(leaf.alternatives)
        leaves.append((*_pose(leaf), success, leaf.error_p95_um, int(leaf.resolved), *others))
        alternatives += map(_pose, leaf.alternatives)
    return {
        "tool": _plain(table.tool),
        "gripper": table.gripper,
        "counts": table.gripper.profile.counts,
        "model": _plain(table.gripper.model),
        "digest": file.digest,
        "limits": table.limits,
        "nodes": nodes,
        "runs": runs,
        "leaves": leaves,
        "alternatives": alternatives,
    }


def _plain(text: str) -> str:
    """Makes a text of the table safe inside a comment: cuts it, and replaces special characters by "_"."""
    return re.sub(r"[^A-Za-z0-9 .,_+-]", "_", text[:LONGEST_TEXT])


@cache
def _templates() -> Environment:
    templates = environment("planner.export", markup=False)
    templates.filters["numbers"] = lambda row: ", ".join(map(str, row))
    templates.filters["wrapped"] = lambda column: textwrap.fill(
        ", ".join(map(str, column)), WIDTH, initial_indent=" " * 8, subsequent_indent=" " * 8
    )
    return templates
