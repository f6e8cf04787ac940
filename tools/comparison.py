"""Compares methods of planning: compiles a job with each, evaluates the table, and formats the figures.

All tables of a row are evaluated in the row's contact world with fresh seeds, even if a method plans with
other assumptions.
"""

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.evaluation.evaluate import evaluate
from planner.job import model as job_file
from planner.job.overrides import changes_of
from planner.world import ContactWorld
from runtime.table import wilson_interval

SEED_WORLD = 0x5431
SEED_TRIALS = 0x5432

Figures = dict[str, Any]


class Row(NamedTuple):
    """A part, and the world in which its decision tables are evaluated: one row of the table of results."""

    name: str  # name of the row: an experiment of the paper, or a part
    part: str  # folder of `trees/`
    materials: str = ""  # materials of finger and part, for people
    paper: float | None = None  # success rate that the paper reports; None without one
    # Changes of the job file, each as "section.key=value".
    job: tuple[str, ...] = ()
    # Further changes that apply to the world of the evaluation only; the planner does not know them.
    world: tuple[str, ...] = ()


class Method(NamedTuple):
    """A way to plan: its name, and the changes of the job that select it.

    With some methods the world of every row changes, too. Both kinds of changes have the form of `Row.job`.
    """

    name: str
    job: tuple[str, ...] = ()
    world: tuple[str, ...] = ()  # changes of the world of every row


# The default; the default with the measured scatter of friction with the table; the default without
# placements proposed by the belief; the paper's two methods.
KNOWN = (
    Method("closed-loop"),
    Method("measured-scatter", ("doubt.least_dof=12",), ("pressure.wishart_dof=12",)),
    Method("fixed-actions", ("actions.proposals=none",)),
    Method("paper", ("search.method=paper",)),
    Method("sensorless", ("search.method=sensorless",)),
)
METHODS = {method.name: method for method in KNOWN}


def table_rows(trees: Path) -> list[Row]:
    """Reads the rows of the paper's Table I from `table1.toml`, and returns them."""
    document = tomllib.loads((trees / "table1.toml").read_text())
    rows = []
    for row in document["row"]:
        job, world = (tuple(row.get(name, ())) for name in ("job", "world"))
        rows.append(Row(row["experiment"], row["part"], row["materials"], row["paper"], job, world))
    return rows


def zoo_rows(trees: Path) -> list[Row]:
    """Returns a row for each part in `trees` that is not in Table I; the row's world is that of the job."""
    taken = {row.part for row in table_rows(trees)}
    folders = sorted(path.parent.name for path in trees.glob("*/job.toml"))
    return [Row(name=folder, part=folder) for folder in folders if folder not in taken]


def run(row: Row, method: Method, trees: Path, trials: int, workers: int | None = None) -> Figures:
    """Compiles the job of a row with a method, and evaluates its table by simulating `trials` parts.

    Returns:
        Figures for JSON. `success_rate` counts parts that the table reports as located and that lie within
        the goal. `within_rate` also counts parts within the goal whose pose the table reports as uncertain:
        the paper counts so, since its robot states a pose at every leaf. If there is no plan, `no_plan` says
        why.
    """
    job = job_file.load(trees / row.part / "job.toml", changes_of((*row.job, *method.job)))
    figures: Figures = {"row": row.name, "part": row.part, "materials": row.materials}
    figures |= {"paper": row.paper, "method": method.name}
    started = perf_counter()
    try:
        plan = compile_job(job, workers=workers, trials=trials)
    except NoPlanError as error:
        return {**figures, "compile_seconds": perf_counter() - started, "no_plan": str(error)}
    figures["compile_seconds"] = perf_counter() - started
    real = job.replaced(f"the world of {row.name}", **changes_of((*row.world, *method.world)))
    world = ContactWorld(real, SEED_WORLD, workers)
    evaluation = evaluate(plan.table, job, world, trials, SEED_TRIALS)
    within = int(np.sum(evaluation.within))
    return {
        **figures,
        **evaluation.summary(),
        "within_rate": within / trials,
        "within_ci95": list(wilson_interval(within, trials)),
        "nodes": len(plan.table.nodes),
        "leaves": len(plan.table.leaves),
        "unresolved_leaves": sum(not leaf.resolved for leaf in plan.table.leaves),
    }


COLUMNS = (
    ("row", lambda f: f["row"]),
    ("part", lambda f: f["part"]),
    ("materials", lambda f: f["materials"]),
    ("paper's robot", lambda f: "" if f["paper"] is None else f"{f['paper']:.3f}"),
    ("method", lambda f: f["method"]),
    ("success", lambda f: _rate(f["success_rate"], f["success_ci95"])),
    ("within 3 mm", lambda f: _rate(f["within_rate"], f["within_ci95"])),
    ("squeezes", lambda f: f"{f['mean_squeezes']:.2f} / {f['max_squeezes']}"),
    ("wrong", lambda f: f"{f['wrong_rate']:.4f}"),
    ("rejected", lambda f: f"{f['reject_rate']:.4f}"),
    ("unresolved", lambda f: f"{f['unresolved_rate']:.4f}"),
    ("crashes", lambda f: str(f["crashes"])),
    ("compile s", lambda f: f"{f['compile_seconds']:.1f}"),
    ("nodes", lambda f: str(f["nodes"])),
)


def markdown(results: Sequence[Figures]) -> str:
    """The results of `run` as a Markdown table, without empty columns."""
    cells = [[_cell(make, figures) for _, make in COLUMNS] for figures in results]
    shown = [k for k in range(len(COLUMNS)) if any(row[k] for row in cells)]
    lines = [[COLUMNS[k][0] for k in shown], ["---"] * len(shown)]
    lines += [[row[k] for k in shown] for row in cells]
    notes = [f"{f['row']}, {f['method']}: {f['no_plan']}" for f in results if "no_plan" in f]
    text = ["| " + " | ".join(line) + " |" for line in lines] + [""] * bool(notes) + notes
    return "\n".join(text) + "\n"


def _cell(make: Callable[[Figures], str], figures: Figures) -> str:
    try:
        return make(figures)
    except KeyError:
        return "-"  # there was no plan to judge


def _rate(rate: float, interval: Sequence[float]) -> str:
    return f"{rate:.4f} ({interval[0]:.4f} to {interval[1]:.4f})"
