"""Squeezes, wrong answers and planning time of a set of parts; not part of the gate.

    python tests/bench/bench_plans.py [--parts hex-nut square ...] [--trials 20000] [--workers 2] [-o FILE]

Every part is planned once. The table is then run on fresh parts in the world of its job, and where the
encoder reads 1 mm short or long. Prints figures and writes `results/plans.json` beside this file, where
parts that are not asked for keep what they had.
"""

import argparse
import json
import platform
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]

from planner.compile import compile_job  # noqa: E402
from planner.evaluation.disturbance import Disturbance  # noqa: E402
from planner.evaluation.evaluate import evaluate  # noqa: E402
from planner.job import model as job_file  # noqa: E402
from planner.job.model import Job  # noqa: E402
from planner.work.scheduler import Threads  # noqa: E402
from planner.world import ContactWorlds  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "plans.json"
TREES = ROOT / "trees"
NOMINAL = {"goal": {"stress_trials": 0}}
SQUARE = [[0, 0], [25, 0], [25, 25], [0, 25]]
BAR = [[0, 0], [20, 0], [20, 4], [0, 4]]
HAND_E = {
    "model": "robotiq-hand-e", "opening_mm": 50.0, "finger_length_mm": 22.0, "finger_width_mm": 10.0,
    "count_open": 0, "count_closed": 255,
}  # fmt: skip
MORE = {
    "rectangle-nominal": ("rectangle", NOMINAL),
    "square": ("hex-nut", {"part": {"outline_mm": SQUARE}}),
    "bar-hand-e": (
        "rectangle",
        {**NOMINAL, "part": {"outline_mm": BAR}, "gripper": HAND_E, "uncertainty": {"radius_mm": 6.0}},
    ),
}
"""Jobs that differ from one of `trees/`, and how."""
OFFSETS_MM = (0.0, -1.0, 1.0)
OTHER_SEED = 1_000_003


def job_of(name: str) -> Job:
    """The job of a part."""
    folder, changes = MORE.get(name, (name, {}))
    return job_file.load(TREES / folder / "job.toml", changes)


def bench(name: str, trials: int, work: Threads) -> dict[str, Any]:
    """One plan: its figures."""
    job = job_of(name)
    began, began_s = time.process_time(), time.perf_counter()
    table = compile_job(job, work.workers).table
    row: dict[str, Any] = {
        "part": name,
        "cpu_seconds": time.process_time() - began,
        "seconds": time.perf_counter() - began_s,
        "nodes": len(table.nodes),
        "leaves": len(table.leaves),
    }
    for offset_mm in OFFSETS_MM:
        worlds = ContactWorlds.of_job(job, OTHER_SEED)
        found = evaluate(table, job, worlds, trials, OTHER_SEED, work, Disturbance(offset_mm))
        row[f"encoder {offset_mm:+g} mm"] = {
            "success": float(found.success.mean()),
            "wrong": float(found.wrong.mean()),
            "rejected": float(found.rejected.mean()),
            "squeezes": float(found.squeezes.mean()),
        }
    told = ["{success:.4f} wrong {wrong:.4f} {squeezes:.3f}".format(**row[key]) for key in list(row)[5:]]
    print(
        f"{name:18} {' | '.join(told)} | {row['cpu_seconds']:.1f} s CPU, {len(table.nodes)} nodes", flush=True
    )
    return row


def main() -> None:
    """Measures and keeps."""
    parts = sorted(path.parent.name for path in TREES.glob("*/job.toml")) + list(MORE)
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts, metavar="PART")
    parser.add_argument("--trials", type=int, default=20_000, help="of a table (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    options = parser.parse_args()
    work = Threads(options.workers)
    compile_job(job_of("rectangle-nominal").replaced(search={"particles": 200}), work.workers, trials=100)
    kept = json.loads(options.output.read_text())["rows"] if options.output.exists() else []
    rows = {row["part"]: row for row in kept}
    for part in options.parts:
        rows[part] = bench(part, options.trials, work)
        told = {"machine": platform.platform(), "python": platform.python_version()}
        told["rows"] = [rows[name] for name in parts if name in rows]
        options.output.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
