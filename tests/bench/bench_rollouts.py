"""How fast roll-outs are made, read back and shared between machines; not part of the gate.

    python tests/bench/bench_rollouts.py [--count 100000] [--only generate cluster sweep]

Prints figures and writes `results/rollouts.json` beside this file. Kernels are compiled before the clock
starts; the cluster is one scheduler and as many workers as there are cores, on this machine.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from problems import OUTLINES, simulator  # noqa: E402

from planner.cli import compile as plan_compile  # noqa: E402
from planner.job import model as job_file  # noqa: E402
from planner.learned.rollouts import (  # noqa: E402
    BLOCK,
    RollOuts,
    region_radius,
    roll_outs,
)
from planner.learned.store import Store  # noqa: E402
from planner.mechanics.simulator import STATUS_NAMES, Simulator  # noqa: E402
from planner.work.scheduler import Cluster, Scheduler, Threads  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "rollouts.json"
JOB = ROOT / "trees" / "rectangle" / "job.toml"
CORES = os.cpu_count() or 1
SWEEP = "uncertainty.radius_mm=6,8,10,12.75"
Row = dict[str, Any]


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call took, and what it returned."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def generate(count: int) -> list[Row]:
    """Roll-outs of the rectangle's job and of other parts: made, kept and read back."""
    job = job_file.load(JOB)
    radius = region_radius(job)
    parts = {"rectangle": Simulator.of_job(job)}
    parts |= {name: simulator(OUTLINES[name]()) for name in ("butterfly", "right triangle", "L")}
    table = []
    for name, part in parts.items():
        roll_outs(part, radius, 1)
        with tempfile.TemporaryDirectory() as folder:
            first, result = timed(lambda: roll_outs(part, radius, count, Store(Path(folder))))  # noqa: B023
            second, again = timed(lambda: roll_outs(part, radius, count, Store(Path(folder))))  # noqa: B023
            files = [path for path in Path(folder).glob("??/*") if path.is_file()]
        row = {
            "part": name,
            "radius_mm": radius,
            "count": count,
            "rolled_out": len(result.initial),
            "first_s": first,
            "second_s": second,
            "same": same(result, again),
            "threads": CORES,
            "files": len(files),
            "per_second": len(result.initial) / first,
            "statuses": dict(
                zip(
                    ("collides", *STATUS_NAMES),
                    np.bincount(result.status + 1).tolist(),
                    strict=False,
                )
            ),
        }
        table.append(row)
        print(
            "{part:15} {rolled_out} of {count} in {first_s:.2f} s, again in {second_s:.3f} s".format(
                **row
            )
        )
    return table


def same(a: RollOuts, b: RollOuts) -> bool:
    """Whether two sets of roll-outs are the same bytes."""
    return all(x.tobytes() == y.tobytes() for x, y in zip(a, b, strict=True))


def cluster(count: int) -> Row:
    """The same roll-outs on a local cluster of processes and on threads."""
    from distributed import LocalCluster

    job = job_file.load(JOB)
    part, radius = Simulator.of_job(job), region_radius(job)

    def seconds(scheduler: Scheduler) -> tuple[float, RollOuts]:
        roll_outs(part, radius, BLOCK * 4, None, scheduler)
        return timed(lambda: roll_outs(part, radius, count, None, scheduler))

    threads, local = seconds(Threads())
    with (
        LocalCluster(
            n_workers=CORES, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as workers,
        Cluster(workers.scheduler_address) as remote,
    ):
        processes, far = seconds(remote)
    row = {
        "count": count,
        "workers": CORES,
        "threads_s": threads,
        "cluster_s": processes,
        "same": same(local, far),
    }
    print(
        "threads {threads_s:.2f} s, {workers} workers of a cluster {cluster_s:.2f} s".format(**row)
    )
    return row


def sweep(_count: int) -> Row:
    """Four jobs of the rectangle, one after the other with all threads and with one."""
    row: Row = {"sweep": SWEEP, "cores": CORES}
    for name, workers in (("all_threads_s", CORES), ("one_thread_s", 1)):
        with tempfile.TemporaryDirectory() as folder:
            words = [str(JOB), "-o", folder, "--workers", str(workers), "--vary", SWEEP]
            plan_compile.main([*words[:3], *words[3:5], "--vary", "uncertainty.radius_mm=4"])
            row[name], _ = timed(lambda: plan_compile.main(words))  # noqa: B023
    print(
        "sweep of four jobs: {all_threads_s:.1f} s on all threads, {one_thread_s:.1f} s on one".format(
            **row
        )
    )
    return row


def main() -> None:
    """Run the chosen benches and record them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100_000, help="of roll-outs")
    benches: dict[str, Callable[[int], Any]] = {
        "generate": generate,
        "cluster": cluster,
        "sweep": sweep,
    }
    parser.add_argument("--only", nargs="+", choices=list(benches), default=list(benches))
    options = parser.parse_args()
    if "cluster" in options.only and find_spec("distributed") is None:
        parser.error("the cluster needs: pip install '.[cluster]'; else --only generate sweep")
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in options.only:
        results[name] = benches[name](options.count)
    results["setting"] = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": CORES,
    }
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
