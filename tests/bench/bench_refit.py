"""Checks the posterior of plan-refit by simulation-based calibration (Talts et al. 2018).

Hidden cells, whose true values the refit does not see, are drawn from the prior, and parts are squeezed in
each. Then the rank of each true value among the draws of the posterior is noted. The ranks are uniform if the
posterior is right. A hidden cell takes about 6 s on a core:

    python tests/bench/bench_refit.py [TABLE] --keep
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import harness
import numpy as np
from programs import TABLE
from scipy.stats import chisquare

from planner.evaluation.expectation import readings
from planner.job import model as job_file
from planner.refit.cells import Cells
from planner.refit.outcomes import Seen
from planner.refit.posterior import Effort, posterior
from planner.work.scheduler import Threads
from runtime.table import load

RESULTS = harness.Kept("refit")
EFFORT = Effort(cells=60, parts=400)
BINS, LEAST_P, COVERED = 10, 0.01, (0.85, 0.95)


def main() -> int:
    parser = harness.parser(__doc__)
    parser.add_argument("tree", type=Path, nargs="?", default=TABLE)
    parser.add_argument("--hidden", type=int, default=200)
    parser.add_argument("--parts", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=1, help="hidden cells at a time")
    parser.add_argument("--keep", action="store_true", help="keep the figures")
    options = parser.parse_args()
    table = load(options.tree).table
    cells = Cells.of(job_file.from_canonical(str(table.job)), table)
    keys = [quantity.key for quantity in cells.space.quantities]
    ranks, errors = [], []
    with ProcessPoolExecutor(options.jobs) as pool:
        for line in pool.map(partial(refitted, cells, options.parts), range(options.hidden)):
            ranks.append(line.pop("ranks"))
            errors.append(line.pop("errors"))
            harness.show({**line, "ranks": dict(zip(keys, ranks[-1].tolist(), strict=True))})
    kept, bad = judge(keys, np.array(ranks), np.array(errors))
    if options.keep:
        RESULTS.write({"hidden": options.hidden, "parts": options.parts, **kept})
    return bad


def refitted(cells, parts, number):
    """Draws the hidden cell `number`, squeezes parts in it, and computes the posterior from their readings.

    Returns:
        The ranks of the true values among the draws of the posterior, the errors of the posterior's mean, its
        spread, and the processor time.
    """
    begun = time.process_time()
    truth = cells.space.draw(1, np.random.default_rng([number, 1]))[0]
    counts = readings(cells.run(truth, parts, number), cells.program.table)
    seen = Seen(counts, parts, np.zeros(0, np.int64), np.zeros((0, 3)))
    drawn = posterior(cells, seen, number, Threads(1), EFFORT).cells[:, :-1]
    return {
        "hidden": number,
        "cpu_s": round(time.process_time() - begun, 1),
        "ranks": (drawn < truth[:-1]).mean(axis=0),
        "errors": drawn.mean(axis=0) - truth[:-1],
        "spread": [float(f"{spread:.3g}") for spread in drawn.std(axis=0)],
    }


def judge(keys, ranks, errors):
    bad, kept = 0, {}
    for key, column, error in zip(keys, ranks.T, errors.T, strict=True):
        histogram = np.histogram(column, BINS, (0.0, 1.0))[0]
        p = float(chisquare(histogram).pvalue)
        covered = float(np.mean((column >= 0.05) & (column <= 0.95)))
        rms = float(np.sqrt(np.mean(error**2)))
        kept[key] = {"ranks": histogram.tolist(), "p": p, "covered": covered, "rms": rms}
        harness.show({key: kept[key]})
        bad += p < LEAST_P or not COVERED[0] <= covered <= COVERED[1]
    return kept, min(bad, 1)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    raise SystemExit(main())
