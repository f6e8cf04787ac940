"""Measures how often plans give confident wrong answers in worlds that differ from their assumptions.

    python tests/bench/bench_worlds.py [--parts butterfly-10 ...] [--trials 20000]

Each job of Table I is planned three times: with doubts about the cell; with these doubts and one about the
scatter of friction with the table, as `plan-init` writes it; and with the doubts and a higher confidence of
the leaves. All plans are evaluated in the standard worlds of `plan-evaluate --sweep`, with the same parts.
Prints figures and writes `results/worlds.json` beside this file. Not part of `tools/check`.
"""

import platform
import time
from typing import Any

import harness
from programs import TREES

from planner.compile import compile_job
from planner.evaluation.cases import standard_cases
from planner.evaluation.evaluate import sweep
from planner.job import model as job_file
from planner.work.scheduler import Threads

RESULTS = harness.Kept("worlds")
PARTS = ("butterfly-10", "butterfly-15", "rectangle", "rectangle-25")
DOUBTS: dict[str, dict[str, Any]] = {
    "doubt": {
        "finger_share": [-0.11, 0.11],
        "middle_mm": [-1.4, 1.4],
        "encoder_mm": [-1.1, 1.1],
        "pressure": "any",
    },
    "part": {"tolerance_mm": 0.33},
}
PLANS: dict[str, dict[str, Any]] = {
    "with [doubt]": DOUBTS,
    "least_dof 12": {**DOUBTS, "doubt": {**DOUBTS["doubt"], "least_dof": 12}},
    "confidence 0.995": {**DOUBTS, "goal": {"confidence": 0.995}},
}
KEPT = ("success_rate", "wrong_rate", "wrong_ci95", "mean_squeezes", "seconds_mean")
SEED = 99
"""Of the parts and the worlds; no plan is made with it."""


def bench(part: str, plan: str, trials: int) -> dict[str, Any]:
    """Plans a part with the changes `PLANS[plan]` of its job; returns a row of figures for all worlds."""
    job = job_file.load(TREES / part / "job.toml")
    start = time.perf_counter()
    table = compile_job(job.replaced(**PLANS[plan])).table
    seconds = time.perf_counter() - start

    record = {}
    for line in sweep(table, job, standard_cases(job), trials, SEED, Threads(2)):
        figures = line.evaluation.summary()
        record[line.case.name] = {key: figures[key] for key in KEPT}
    worst = max(record, key=lambda name: record[name]["wrong_rate"])
    row = {"part": part, "plan": plan, "seconds": seconds, "nodes": len(table.nodes)}
    harness.show({**row, "worst": worst, **record[worst]})
    return {**row, "worlds": record}


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--trials", type=int, default=20_000, help="parts in each world")
    options = parser.parse_args()
    rows = [bench(part, plan, options.trials) for part in options.parts for plan in PLANS]
    record = {"machine": platform.platform(), "trials": options.trials, "rows": rows}
    RESULTS.write(record)


if __name__ == "__main__":
    main()
