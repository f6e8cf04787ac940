"""Progressive widening against exhaustive look-ahead, and with hundreds of placements; not part of the gate.

    python tests/bench/bench_search.py [--only small large] [--seeds 1 2]

Every placement is squeezed once; then the few most promising are followed further (the default), or all of
them. Both plan the rectangle with 4 and with 12 placements; with 24 and 180, all of them would take hours,
and only widening is measured. Prints figures and writes `results/search.json` beside this file.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]

import numpy as np  # noqa: E402
from planner.search.params import SearchParams  # noqa: E402

from planner import compile as planning  # noqa: E402
from planner.job import model as job_file  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "search.json"
JOB = ROOT / "trees" / "rectangle" / "job.toml"
WIDENED = planning.PARAMS.followed
ALL = 10**6
ANGLES = {4: 45, 12: 15, 24: 7.5, 180: 5}
CENTERS = {4: "[[0, 0]]", 12: "[[0, 0]]", 24: "[[0, 0]]", 180: "[[-10, 0], [-5, 0], [0, 0], [5, 0], [10, 0]]"}
CASES = {
    "small": [(4, WIDENED), (4, ALL), (12, WIDENED), (12, ALL)],
    "large": [(24, WIDENED), (180, WIDENED)],
}


def bench(placements: int, followed: int, seed: int) -> dict[str, Any]:
    """One plan."""
    angles = np.arange(0, 180, ANGLES[placements]).tolist()
    actions = {"angles_deg": angles, "centers_mm": json.loads(CENTERS[placements])}
    job = job_file.load(JOB, {"seed": seed, "actions": actions})
    finalists = max(followed, SearchParams().finalists)
    planning.PARAMS = replace(planning.PARAMS, followed=followed, finalists=finalists)
    start = time.perf_counter()
    plan = planning.compile_job(job)
    seconds = time.perf_counter() - start
    figures = plan.evaluation.summary()
    row = {
        "placements": placements,
        "followed": "all" if followed == ALL else followed,
        "seed": seed,
        "seconds": seconds,
        "success": figures["success_rate"],
        "squeezes": figures["mean_squeezes"],
    }
    print(
        f"{placements:3} placements, {row['followed']!s:9} followed, seed {seed}: "
        f"success {row['success']:.4f}, {row['squeezes']:.2f} squeezes, {seconds:.1f} s",
        flush=True,
    )
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    options = parser.parse_args()
    cases = [case for name in options.only for case in CASES[name]]
    rows = [bench(n, followed, seed) for n, followed in cases for seed in options.seeds]
    told = {"machine": platform.platform(), "python": platform.python_version(), "rows": rows}
    RESULTS.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
