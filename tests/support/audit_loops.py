"""Runs `grasp-runtime --port sim --audit` with a rendered camera, and compares the audits with the truth."""

import json
import math
import shlex
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from programs import RUNTIME, ended

from runtime.journal.chain import records
from runtime.table import Table

# Distances by which `mixed` moves the poses of leaf k, k + 8, ... [mm]; some are close to the goal of 3 mm.
OFF_MM = (0.0, 3.03, 0.0, 2.85, 3.12, 3.2, 5.0, 4.0)


class Judged(NamedTuple):
    """An audited part: the answer of the audit, and where the part truly was.

    Attributes:
        answer: the audit's record in the journal.
        error_mm: true distance of the part from the leaf's pose.
        within: whether this distance is within the goal.
    """

    answer: dict[str, Any]
    error_mm: float
    within: bool


def mixed(table: Table) -> Table:
    """Returns the table with displaced poses of leaves; the leaves get the distances in `OFF_MM` in turn.

    A distance above the goal makes a leaf wrong; a distance of 0 leaves it unchanged.
    """
    leaves = []
    for number, leaf in enumerate(table.leaves):
        off_um, bearing = 1e3 * OFF_MM[number % len(OFF_MM)], 2.4 * number
        x_um = leaf.x_um + round(off_um * math.cos(bearing))
        leaves.append(leaf._replace(x_um=x_um, y_um=leaf.y_um + round(off_um * math.sin(bearing))))
    return replace(table, leaves=tuple(leaves))


def command(tree: Path, folder: Path, *, count: int, seed: int, time_scale: float) -> list[str]:
    """Returns the command of an audited run in a simulated cell.

    `folder` holds camera.json and tag.json for the audit, and receives the journal.
    """
    audit = [sys.executable, "-m", "drivers.camera.audit.command", "judge", "--tree", str(tree)]
    audit += ["--calibration", str(folder / "camera.json"), "--tag", str(folder / "tag.json")]
    audit += ["--deadline", "9.5"]
    words = [*RUNTIME, "--tree", str(tree), "--port", "sim", "--world", "planner.world:make"]
    words += ["--json", "--count", str(count), "--seed", str(seed)]
    words += ["--time-scale", str(time_scale), "--journal", str(folder / "journal.jsonl")]
    return [*words, "--audit", f"{shlex.join(audit)} --camera {{camera}}"]


class Loop(NamedTuple):
    """Results of several runs.

    Attributes:
        parts: the audited parts.
        outcomes: number of parts with each outcome, audited or not.
        faults: reason of each part that ended in a fault, and of each run that did not start.
    """

    parts: list[Judged]
    outcomes: Counter[str]
    faults: list[str]


def loop(
    tree: Path, folder: Path, *, parts: int, seed: int, time_scale: float, runs: int = 20
) -> Loop:
    """Runs `grasp-runtime` until `parts` parts are audited; returns the results of all runs.

    A fault ends a run, and the next run has the next seed; there are at most `runs` runs. At a high
    `time_scale` a busy machine may exceed the deadlines of gripper and arm. The audit does not cause such
    faults: they are collected, and do not count as failures.
    """
    result = Loop([], Counter(), [])
    for number in range(runs):
        if (left := parts - len(result.parts)) <= 0:
            break
        words = command(tree, folder, count=left, seed=seed + number, time_scale=time_scale)
        before = len(of_runs(folder / "journal.jsonl"))
        _, out, err = ended(words, timeout=None)
        runs_now = of_runs(folder / "journal.jsonl")[before:]
        if not runs_now:  # the cell did not start
            result.faults.append(err.strip().rpartition("\n")[2])
            continue
        more, run = judged(out, runs_now[0])
        result.parts.extend(more)
        result.outcomes.update(part["outcome"] for part in run)
        result.faults.extend(part["reason"] for part in run if part["outcome"] == "fault")
    return result


def of_runs(journal: Path) -> list[list[dict[str, Any]]]:
    """Returns the runs in a journal, each as the list of its records; a missing journal has no runs."""
    runs: list[list[dict[str, Any]]] = []
    for record in records(journal) if journal.exists() else ():
        if record["kind"] == "header":
            runs.append([])
        runs[-1].append(dict(record))
    return runs


def judged(said: str, run: list[dict[str, Any]]) -> tuple[list[Judged], list[dict[str, Any]]]:
    """Returns the audited parts of one run, and all parts of the run as `--json` prints them.

    Args:
        said: standard output of the run.
        run: the run's records in the journal.
    """
    document = {part["part"]: part for part in map(json.loads, said.splitlines())}
    asked = [(record, document[record["part"]]) for record in run if record["kind"] == "audit"]
    pairs = [Judged(record, part["error_mm"], part["within_goal"]) for record, part in asked]
    return pairs, list(document.values())


def agreement(parts: list[Judged]) -> dict[str, Any]:
    """Returns figures of how well the audit's verdicts agree with the true distances.

    `false_passes` counts parts outside the goal that the audit passed. `beyond_the_budget` counts parts for
    which measured and true distance differ by more than the error that the audit states.
    """
    given = [part for part in parts if part.answer["verdict"] != "unknown"]
    measured = [part for part in parts if "distance" in part.answer]
    off = [abs(part.answer["distance"] - part.error_mm) / part.answer["error"] for part in measured]
    unknown = [part.answer["reason"].partition(":")[0] for part in parts if part not in given]
    agree = [(part.answer["verdict"] == "pass") == part.within for part in given]
    return {
        "at_leaves": len(parts),
        "verdicts": dict(Counter(part.answer["verdict"] for part in parts)),
        "unknown_because": dict(Counter(unknown)),
        "truly_within": sum(part.within for part in parts),
        "agreement": sum(agree) / len(agree) if agree else None,
        "false_passes": sum(part.answer["verdict"] == "pass" and not part.within for part in given),
        "false_fails": sum(part.answer["verdict"] == "fail" and part.within for part in given),
        "beyond_the_budget": sum(share > 1.0 for share in off),
        "largest_error_in_units_of_the_budget": max(off, default=None),
    }
