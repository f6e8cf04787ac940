"""Compares the mean squeezes of the plans of `trees/` with a lower bound for plans of equal success.

    python tests/bench/bench_bound.py [--only rectangle t-bolt] [--parts 50000] [--dense]

The plan of a job is its table in `trees/`, else the table that an earlier run left in `out/tables-12`, else a
new one. Prints figures and writes `results/bound.json` beside this file; rows of jobs that are not measured
again stay. Not part of `tools/check`.
"""

import time
from typing import Any

import harness
from tree_tables import NAMES, TREES, table_of

from planner.bound.certificate import PARTS, certify
from planner.job import model as job_file

RESULTS = harness.Kept("bound")
TABLE1 = ("butterfly-10", "butterfly-15", "rectangle", "rectangle-25")


def bench(name: str, parts: int, dense: bool) -> dict[str, Any]:
    """Computes the lower bound for a job's table; returns the bound and the table's mean squeezes."""
    job = job_file.load(TREES / name / "job.toml")
    table = table_of(name).table
    start = time.process_time()
    result = certify(job, table, parts, dense)
    row = {"job": name, "mean_squeezes": result.mean, **result.figures()}
    row["cpu_seconds"] = round(time.process_time() - start, 1)
    harness.show(row)
    return row


def main() -> None:
    parser = harness.parser(__doc__)
    names = [*TABLE1, *sorted({*NAMES} - {*TABLE1})]
    parser.add_argument("--only", nargs="+", choices=NAMES, default=names)
    parser.add_argument("--parts", type=int, default=PARTS)
    parser.add_argument("--dense", action="store_true")
    options = parser.parse_args()
    kept = RESULTS.read([])
    rows = {(row["job"], row["dense"]): row for row in kept}
    for name in options.only:
        row = bench(name, options.parts, options.dense)
        rows[name, options.dense] = row | {"dense": options.dense}
        lines = [rows[key] for key in sorted(rows)]
        RESULTS.write(lines)


if __name__ == "__main__":
    main()
