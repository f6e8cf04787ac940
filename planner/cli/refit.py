"""plan-refit: learns a cell's latent parameters from journals of a job's table, and writes a new job."""

import argparse
import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from planner.cli import course, shell
from planner.evaluation.outcome import Evaluation
from planner.job import documents
from planner.job import model as job_file
from planner.job.model import Job
from planner.refit import cell_times
from planner.refit.cell_times import Timed
from planner.refit.cells import Cells
from planner.refit.findings import changes, findings
from planner.refit.outcomes import Seen
from planner.refit.posterior import Effort, Posterior, posterior
from planner.report import run_log
from planner.report.run_log import PartLog
from planner.work.scheduler import Scheduler
from runtime.shell.command import Parser, positive_int
from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import fitting, quoted, usable, write
from runtime.shell.sealed_lines import check_distinct
from runtime.table import Table, TableFile, names_table

NAME = "plan-refit"
LEAST_PARTS = 20
MOST_RESIDUAL_MM = 1e3
RESIDUAL = ("residual_x_mm", "residual_y_mm", "residual_theta_rad")
PREVIEW = (16, 400)  # cells of the posterior in which the table is tried, and parts in each


def parser() -> Parser:
    """The parser of the command line."""
    command = shell.parser(
        NAME,
        "Learn a cell's latent parameters from its journals: how the fingers share the closing, where they "
        "meet, the offset of widths, friction, pressure. Writes the job with doubts as narrow as the "
        "data allow.",
        f"{NAME} lever.toml --journal monday.jsonl tuesday.jsonl -o lever2.toml",
        f"{NAME} lever.toml --journal run.jsonl --audit parts.csv -o lever2.toml --json",
    )
    add = command.add_argument
    add("job", type=Path, metavar="JOB.toml", help="the job that the table was compiled from")
    several: dict[str, Any] = {"type": Path, "nargs": "+", "action": "extend"}
    journals = "journals of runs of one table of this job; their audits count, too"
    add("--journal", required=True, metavar="J", help=journals, **several)
    audits = "measured poses as grasp-audit report --export writes them, one file for each journal"
    add("--audit", default=[], metavar="A.csv", help=audits, **several)
    shell.add_output(command, "JOB2.toml", "the job file to write")
    shell.add_seed(command, "of the simulation")
    text = "cells to simulate in each round: more take longer, with finer results (default: %(default)s)"
    add("--cells", type=positive_int, default=Effort().cells, help=text)
    shell.add_scheduler(command)
    return command


def _refit(arguments: argparse.Namespace) -> None:
    usable(arguments.output, *job_file.files(arguments.job), *arguments.journal, *arguments.audit)
    if arguments.output.exists() and names_table(arguments.output.read_bytes()):
        problem = f"{arguments.output} is a table, which a cell may run"
        raise UsageError(f"{problem}; a refit writes a job: name JOB2.toml")
    fitting(arguments.output, "a job file", ".toml")
    text, job = documents.read(arguments.job), job_file.load(arguments.job)
    shell.check_one_part(job.hypothesis, str(arguments.job), "a refit")
    loaded, parts = _parts(arguments, job)
    seen = seen_of_parts(parts, loaded.table)
    if seen.parts < LEAST_PARTS:
        problem = f"the journals hold {seen.parts} squeezed parts, too few to learn from"
        raise UsageError(f"{problem}; run {LEAST_PARTS} or more")
    cells = Cells.of(job, loaded.table)
    with (
        shell.scheduler(arguments) as scheduler,
        shell.progress(arguments.json, course.counted) as report,
    ):
        effort = Effort(cells=arguments.cells)
        result = posterior(cells, seen, arguments.seed, scheduler, effort, report)
        wrong, rejected = _preview(cells, result, arguments.seed, scheduler)
    cell = cell_times.learned(loaded.table, timed(parts))
    changed = {**changes(result, cells), **({"cell": cell} if cell else {})}
    learned = edited(text, changed)
    refitted = job_file.parse(learned, str(arguments.output))
    if refitted != job.replaced(str(arguments.output), **changed):
        problem = "its text cannot be edited; write each section once"
        raise InputError(problem, where=str(arguments.job))
    write(arguments.output, learned)
    learned_of_each = findings(result, cells)
    ordered = sorted(learned_of_each, key=lambda finding: not finding.learned)
    figures = {
        "parts": seen.parts,
        "squeezes": int(seen.readings.sum()),
        "audited": len(seen.leaves),
        "findings": [finding._asdict() for finding in learned_of_each],
        "changes": changed,
        "wrong_rate_as_learned": wrong,
        "reject_rate_as_learned": rejected,
        "written": str(arguments.output),
    }
    shell.answer(
        arguments.json,
        figures,
        f"{seen.parts} parts, {seen.readings.sum()} squeezes, {len(seen.leaves)} audited; 90 % intervals:",
        *(f"  {finding.sentence}" for finding in ordered),
        f"in such a cell this table answers {100 * wrong:.1f} % wrongly and rejects {100 * rejected:.1f} %",
        *(f"  cell.{key} = {value:g}" for key, value in cell.items()),
        f"wrote {arguments.output}; next: plan-compile {quoted(arguments.output)}",
    )


def _parts(arguments: argparse.Namespace, job: Job) -> tuple[TableFile, list[PartLog]]:
    """Returns the table of the journals, and the parts of all journals with their audited poses.

    Raises:
        InputError: a journal or an audit cannot be used.
        UsageError: two journals have a run in common, or there is not one audit for each journal.
    """
    check_distinct(arguments.journal)
    loaded = run_log.table_of(arguments.journal[0])
    text = loaded.table.job
    compiled = job_file.from_canonical(text) if text else job
    same_search = compiled.replaced(search=asdict(job.search))  # a first answer searches less
    if same_search != job if text else loaded.table.job_digest != job.digest():
        problem = f"is of a table of another job than {arguments.job}; name the job that it was compiled from"
        raise InputError(problem, where=str(arguments.journal[0]))
    runs = [run_log.read(path, loaded.digest) for path in arguments.journal]
    for path, run in zip(arguments.journal, runs, strict=True):
        if run.others:
            problem = "holds runs of another table, too; refit one table at a time"
            raise InputError(problem, where=str(path))
    if arguments.audit and len(arguments.audit) != len(runs):
        counts = f"{len(arguments.audit)} --audit for {len(runs)} --journal"
        raise UsageError(f"{counts}; name one for each")
    for path, run in zip(arguments.audit, runs, strict=False):
        _measured(path, [part for part in run.parts if part.outcome != "cut short"])
    return loaded, [part for run in runs for part in run.parts]


def _measured(path: Path, parts: Sequence[PartLog]) -> None:
    """Reads a CSV file of audits and sets the residual of each audited part: measured less predicted pose."""
    rows, left = list(csv.DictReader(documents.read(path).splitlines())), dict(enumerate(parts))
    try:
        for row in rows:
            if all(row[name] for name in RESIDUAL):
                x, y, theta = (float(row[name]) for name in RESIDUAL)
                index = int(row["index"])
                near = math.hypot(x, y) <= MOST_RESIDUAL_MM and abs(theta) <= math.tau  # not if nan
                left.pop(index if near else -1).residual = (x, y, theta)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        problem = "is no table of its journal's parts; make it with grasp-audit report --export"
        raise InputError(problem, where=str(path)) from error


def seen_of_parts(parts: Sequence[PartLog], table: Table) -> Seen:
    """Counts the readings at each node, and collects the residuals of audited parts.

    The readings of a part count up to its first leaf or rejected reading. Later readings belong to another
    attempt, in which the part does not lie as a new part would.
    """
    gripper = table.gripper
    counts, squeezed = np.zeros((len(table.nodes), gripper.bins), np.int64), 0
    leaves, residuals = [], []
    for part in parts:
        squeezed += bool(part.squeezes)
        target: int | None = 0
        for node, width_um, target in part.squeezes:
            # The journal's gripper may be calibrated; the simulated one, to which widths are compared, is
            # nominal.
            counts[node, gripper.bin_of(width_um)] += 1
            if target is None or target < 0:
                break
        if part.residual is not None and part.leaf is not None and target == ~part.leaf:
            leaves.append(part.leaf)
            residuals.append(part.residual)
    return Seen(counts, squeezed, np.array(leaves, np.int64), np.array(residuals).reshape(-1, 3))


def timed(parts: Sequence[PartLog]) -> list[Timed]:
    """Lists squeezes with their durations; leaves out parts of which a squeeze is not timed."""
    return [
        Timed(node, width_um / 1e3, number + 1 == len(part.squeezes), phases)
        for part in parts
        if len(part.phases) == len(part.squeezes)
        for number, ((node, width_um, _), phases) in enumerate(
            zip(part.squeezes, part.phases, strict=True)
        )
    ]


def _preview(
    cells: Cells, posterior: Posterior, seed: int, scheduler: Scheduler
) -> tuple[float, float]:
    """Simulates some cells of the posterior; returns their mean shares of wrong and of rejected parts.

    What the journals do not determine is in these cells as the job states it.
    """
    (number, parts), learned = (
        PREVIEW,
        {each.quantity for each in findings(posterior, cells) if each.learned},
    )
    points = posterior.cells[:number].copy()
    for column, quantity in enumerate(cells.space.quantities):
        if quantity.key not in learned:
            points[:, column] = quantity.stated
    if "pressure" not in learned:
        points[:, -1] = 0
    jobs = [(cells, point, parts, seed + k) for k, point in enumerate(points)]
    tried = list(scheduler.map(_run, jobs))
    return float(np.mean([t.wrong for t in tried])), float(np.mean([t.rejected for t in tried]))


def _run(job: tuple[Cells, Any, int, int]) -> Evaluation:
    cells, point, parts, seed = job
    return cells.run(point, parts, seed)


def edited(text: str, changed: Mapping[str, Mapping[str, Any]]) -> str:
    """Replaces values in the text of a job file; everything else, comments too, stays as written.

    A section that gets a new `kind` loses its other keys, except `wishart_dof`.
    """
    document = tomlkit.parse(text)
    for section, values in changed.items():
        if section not in document:
            document[section] = tomlkit.table()
        table: Any = document[section]
        if values.get("kind"):
            for key in set(table) - {"wishart_dof"}:
                del table[key]
        for key, value in values.items():
            table[key] = value
    return tomlkit.dumps(document)


main = shell.main_of(parser, _refit)
