"""Compares the seconds a part that tables forecast with those of the simulated cell in virtual time.

    python tests/bench/bench_seconds.py TREE.msgpack [TREE.msgpack ...] [--count 500] [--trials 20000]

The forecast is that of `plan-evaluate`: fresh trials, timed by the table's model of time. The cell is that of
`grasp-runtime --port sim --time-scale max`, whose devices take their own times.

The 95th percentile of a few hundred parts scatters, most of all where few paths of the tree are much longer
than the others. Therefore the forecast states the 95 % interval of the percentile, and the model of time is
also applied to the very squeezes that the cell made.

Writes `results/seconds.json`, and prints it as a table.
"""

import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from math import sqrt
from pathlib import Path
from statistics import fmean
from typing import Any

import harness
import numpy as np
from kept import table_of
from programs import RUNTIME, VIRTUAL, ended

from planner.evaluation.evaluate import evaluate
from planner.job import model as job_file
from planner.world import ContactWorlds
from runtime.table import REJECT, Schedule, Squeezed, Table, job_of, load, takt_figures

RESULTS = harness.Kept("seconds")
SEED = 52
REJECTED, UNRESOLVED = 10, 11  # exit codes of runs whose parts all came to an outcome


Figures = dict[str, float]
Part = dict[str, Any]  # as `grasp-runtime --json` prints it


def forecast(table: Table, trials: int, count: int) -> Figures:
    """Forecasts the seconds of parts from trials.

    The result also has the 95 % interval of the 95th percentile of the seconds of `count` parts.
    """
    job = job_file.from_canonical(str(table.job))
    run = evaluate(table, job, ContactWorlds.of_job(job, SEED), trials, SEED)
    scatter = 1.96 * sqrt(0.95 * 0.05 / count)
    low, high = np.quantile(run.seconds, [0.95 - scatter, 0.95 + scatter]).round(4).tolist()
    ends = {name: float(getattr(run, name).sum()) for name in ("rejected", "unresolved", "wrong")}
    times = _timed(Counter(run.seconds.tolist()), float(run.squeezes.mean()))
    return {**times, **ends, "seconds_p95_low": low, "seconds_p95_high": high}


def cell_run(tree: Path, count: int) -> list[Part]:
    """Runs parts in the simulated cell; returns them as `grasp-runtime --json` prints them.

    Raises:
        SystemExit: the run ended with a fault.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = ["--count", count, "--seed", SEED, "--journal", f"{folder}/journal.jsonl", "--json"]
        run = ended([*RUNTIME, *VIRTUAL, "--tree", tree.resolve(), *words], timeout=None)
    if run.code not in (0, REJECTED, UNRESOLVED):
        raise SystemExit(f"{tree}: the run ended with exit code {run.code}: {run.err}")
    return [json.loads(line) for line in run.out.splitlines()]


def measured(parts: Sequence[Part]) -> Figures:
    """Figures of the parts of a run: their seconds and squeezes, and how many were not located rightly."""
    outcomes = Counter(part["outcome"] for part in parts)
    wrong = sum(part["outcome"] == "leaf" and not part["within_goal"] for part in parts)
    ends = {"rejected": outcomes["reject"], "unresolved": outcomes["unresolved"], "wrong": wrong}
    squeezes = fmean(len(part["path"]) for part in parts)
    return {**_timed(Counter(part["seconds"] for part in parts), squeezes), **ends}


def same_squeezes(table: Table, parts: Sequence[Part]) -> Figures:
    """Figures of a run's parts, with the seconds that the table's model of time gives for their squeezes."""
    schedule = Schedule.of(table, job_of(table))

    def seconds() -> Iterator[float]:
        before = None
        for part in parts:
            took = list(_squeezed(table, part))
            yield sum(phases.total_s for phases in schedule.part(took, before))
            _, before, _ = schedule.squeeze(took[-1], None, None, first=True)

    return _timed(Counter(seconds()), fmean(len(part["path"]) for part in parts))


def _squeezed(table: Table, part: Part) -> Iterator[Squeezed]:
    """Yields the node, width and branch of each squeeze of a part, as `grasp-runtime --json` prints it."""
    leaf = [] if part["leaf"] is None else [~part["leaf"]]
    targets = [*part["path"][1:], *leaf, REJECT]
    for node, width_mm, target in zip(part["path"], part["readings_mm"], targets, strict=False):
        leads_to = [branch.target for branch in table.nodes[node].branches]
        branch = leads_to.index(target) if target in leads_to else REJECT
        yield Squeezed(node, width_mm, branch)


def _timed(seconds: Counter[float], squeezes: float) -> Figures:
    times = {name: round(value, 4) for name, value in takt_figures(seconds).items()}
    return {"parts": seconds.total(), "squeezes": round(squeezes, 4), **times}


def main() -> None:
    """Measures each table, writes the results, and prints them as a table."""
    parser = harness.parser(__doc__)
    parser.add_argument("trees", type=Path, nargs="+", metavar="TREE.msgpack")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--trials", type=int, default=20_000)
    given = parser.parse_args()
    rows = []
    for tree in given.trees:
        table, parts = load(tree).table, cell_run(tree, given.count)
        row = {"part": tree.stem, "forecast": forecast(table, given.trials, given.count)}
        row |= {"measured": measured(parts), "same_squeezes": same_squeezes(table, parts)}
        rows.append(row)
        RESULTS.write(rows)
    print(table_of("seconds"))


if __name__ == "__main__":
    main()
