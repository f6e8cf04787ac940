"""Compares plans with and without pushes before squeezes (`actions.pushes`): do pushes pay?

    python tests/bench/bench_push_actions.py [--seeds 3] [CASE ...]

Each case is a job of `trees/`: as it is, or with jaws that open only 50 mm and another disc of initial
positions. It is planned with pushes and without, each with several seeds; in both, nodes may squeeze at grasp
poses derived from their belief (`actions.proposals`). Prints the cell's squeezes, seconds and success, the
crashes of an open finger, and the processor time of planning. Writes `results/push_actions.json` beside this
file; cases that are not named stay in it. Not part of `tools/check`.
"""

import time
from typing import Any

import harness
import numpy as np
from programs import TREES

from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.job import model as job_file

RESULTS = harness.Kept("push_actions")
WAYS: dict[str, dict[str, Any]] = {
    "squeezes": {"actions": {"proposals": "belief", "pushes": "none"}},
    "pushes": {"actions": {"proposals": "belief", "pushes": "belief"}},
}
AS_THEY_ARE = ("rectangle", "rectangle-25", "wedge", "clevis", "hook-jaw", "butterfly-15")
IN_NARROW_JAWS = (("rectangle", 10), ("rectangle", 15), ("rectangle", 20), ("wedge", 12))
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    f"{name}, 50 mm jaws, disc of {radius} mm": (
        name,
        {"gripper": {"opening_mm": 50.0}, "uncertainty": {"radius_mm": float(radius)}},
    )
    for name, radius in IN_NARROW_JAWS
}
CASES |= {name: (name, {}) for name in AS_THEY_ARE}


def planned(name: str, changes: dict[str, Any], seed: int) -> dict[str, Any]:
    """Plans a changed job with a seed; returns the plan's figures, or why there is no plan."""
    job = job_file.load(TREES / name / "job.toml", {**changes, "seed": seed})
    begun = time.process_time()
    try:
        plan = compile_job(job)
    except NoPlanError as error:
        return {"no_plan": str(error), "cpu_s": time.process_time() - begun}
    result, pushes = plan.evaluation, np.array([len(node.pushes) for node in plan.table.nodes])
    on_path = pushes[np.maximum(result.path, 0)]
    return {
        "success": float(result.success.mean()),
        "squeezes": float(result.squeezes.mean()),
        "seconds": float(result.seconds.mean()),
        "crashes": int(result.crashes),
        "parts": len(result.leaf),
        "pushes": float(on_path.sum(axis=1, where=result.path >= 0).mean()),
        "cpu_s": time.process_time() - begun,
    }


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="default: all")
    parser.add_argument("--seeds", type=int, default=3, help="plans each way")
    options = parser.parse_args()
    kept = RESULTS.read({})
    for case in options.cases or CASES:
        name, changes = CASES[case]
        for way, more in WAYS.items():
            seeds = range(1, options.seeds + 1)
            rows = [planned(name, {**changes, **more}, seed) for seed in seeds]
            kept.setdefault(case, {})[way] = rows
            plans = [row for row in rows if "no_plan" not in row]
            keys = ("squeezes", "seconds", "success", "crashes", "pushes", "cpu_s")
            means = {key: float(np.mean([row[key] for row in plans])) for key in keys if plans}
            counted = f"{len(plans)} of {len(rows)}"
            harness.show({"case": case, "way": way, "plans": counted, **means})
            RESULTS.write(kept)


if __name__ == "__main__":
    main()
