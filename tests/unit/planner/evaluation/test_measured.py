"""What an evaluation says of a table, written into it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import with_figures
from planner.job import model as job_file
from planner.world import ContactWorlds
from runtime.table import load

FOLDER = Path(__file__).parents[4] / "trees" / "rectangle"


def test_with_figures_leaf_that_the_jaws_could_not_hold_is_unresolved() -> None:
    """Its few trials say nothing against it: squeezes that the simulator gave up end all alike."""
    job = job_file.load(FOLDER / "job.toml")
    table = load(FOLDER / "rectangle.msgpack").table
    run = evaluate(table, job, ContactWorlds.of_job(job, 1), 50, 1)
    index = next(
        k for k in range(len(table.leaves)) if k not in run.leaf and table.leaves[k].resolved
    )
    leaf = table.leaves[index]
    elsewhere = leaf._replace(x_um=leaf.x_um + 15_000, y_um=leaf.y_um + 15_000)
    leaves = (*table.leaves[:index], elsewhere, *table.leaves[index + 1 :])
    sound, _ = with_figures(table, run, job)
    measured, _ = with_figures(replace(table, leaves=leaves), run, job)
    assert sound.leaves[index].resolved
    assert not measured.leaves[index].resolved
