"""Compares the failure rate that a plan reports with the rate of fresh trials, not used in planning.

    python tests/bench/bench_fresh.py [--seeds 10] [--trials 4000] [--workers 2]

Four jobs are planned with few particles and with several seeds. A table reports the failure rate of its last
evaluation. Three times as many trials with other seeds then estimate this rate again. If planning does not
favour its own trials, the mean difference of the rates lies within two standard errors of zero (`z`).

Prints figures and writes `results/fresh.json` beside this file. Not part of `tools/check`.
"""

import math
import platform
from itertools import product
from typing import Any

import harness
from programs import TREES

from planner.compile import compile_job
from planner.evaluation.evaluate import evaluate
from planner.job import model as job_file
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.table import PPM

RESULTS = harness.Kept("fresh")
PARTS = ("rectangle", "hex-nut", "oval-cover", "ratchet")
FEW = {"search": {"particles": 2000}}
TIMES = 3
OTHER_SEED = 1_000_003


def bench(part: str, seed: int, trials: int, work: Threads) -> dict[str, Any]:
    """Plans a part with a seed; returns the failures that the table reports, and those of fresh trials."""
    job = job_file.load(TREES / part / "job.toml", {"seed": seed, **FEW})
    table = compile_job(job, work.workers, trials).table
    other = OTHER_SEED + seed
    fresh = evaluate(table, job, ContactWorlds.of_job(job, other), TIMES * trials, other, work)
    row = {
        "part": part,
        "seed": seed,
        "reported": round((1.0 - table.predicted.success_ppm / PPM) * table.predicted.trials),
        "trials": table.predicted.trials,
        "fresh": int((~fresh.success).sum()),
        "fresh_trials": TIMES * trials,
    }
    harness.show(row)
    return row


def bias(rows: list[dict[str, Any]]) -> dict[str, float]:
    """The mean reported and fresh failure rates, and their difference in standard errors (`z`)."""
    reported = [row["reported"] / row["trials"] for row in rows]
    fresh = [row["fresh"] / row["fresh_trials"] for row in rows]
    variance = 0.0
    for row in rows:
        rate = (row["reported"] + row["fresh"]) / (row["trials"] + row["fresh_trials"])
        variance += rate * (1.0 - rate) * (1.0 / row["trials"] + 1.0 / row["fresh_trials"])
    mean_reported, mean_fresh = sum(reported) / len(rows), sum(fresh) / len(rows)
    z = (sum(reported) - sum(fresh)) / math.sqrt(variance)
    return {"reported": mean_reported, "fresh": mean_fresh, "plans": len(rows), "z": z}


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="of each job")
    parser.add_argument("--trials", type=int, default=4000, help="a plan's own")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    work = Threads(options.workers)
    every = product(range(options.seeds), PARTS)
    rows = [bench(part, seed, options.trials, work) for seed, part in every]
    result = bias(rows)
    harness.show(result)
    machine = {"machine": platform.platform(), "python": platform.python_version()}
    RESULTS.write({**machine, **result, "rows": rows})


if __name__ == "__main__":
    main()
