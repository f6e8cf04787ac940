"""Compares plans for a 2F-85 with plans for the same gripper with a finer reading.

    python tests/bench/bench_resolution.py [--sample 24] [--budget 90s] [--cpu 2400s]

Randomly drawn outlines of tools/zoo500, and three parts of trees/, are planned twice: with a 2F-85, and with
a gripper that reads 0.01 mm with a noise of 0.02 mm. Writes `results/resolution.json` beside this file after
each plan: names and figures, no outlines. Plans that are in it are not made again. Needs the packages that
the outlines of tools/zoo500 come from. Not part of `tools/check`.
"""

import random
import sys
import time
from collections.abc import Iterator
from itertools import product
from statistics import mean
from typing import Any

import harness
import zoo_sources
from programs import TREES

from planner.compile import compile_job
from planner.job import model as job_file
from planner.report.zoo import Item, judge
from planner.work.limit import Limit
from runtime.shell.command import seconds

RESULTS = harness.Kept("resolution")
GRIPPERS: dict[str, dict[str, float]]
GRIPPERS = {"2F-85": {}, "0.01 mm": {"resolution_mm": 0.01, "noise_mm": 0.02}}
PARTS, SEEDS = ("rectangle", "gusset", "egg-cam"), (1, 2, 3)
SHOWN = ("mean_squeezes", "seconds_mean", "error_mm")
KEPT = ("kind", "cut", "success_rate", "wrong_rate", *SHOWN)


def zoo(sample: int, budget_s: float) -> Iterator[tuple[str, str, Any]]:
    """Draws outlines of the zoo; yields name, gripper, and a function that makes and judges the plan."""
    known = zoo_sources.outlines()
    names = sorted(name for name in known if not zoo_sources.kept_aside(name))
    base = job_file.load(TREES / "ratchet" / "job.toml")
    for name in random.Random(1).sample(names, min(sample, len(names))):
        for gripper, reading in GRIPPERS.items():
            job = base.replaced(search={"method": "closed-loop"}, gripper=reading)
            item = Item(name, known[name].tolist(), job.canonical(), budget_s)
            yield name, gripper, lambda item=item: judge(item)


def parts(budget_s: float) -> Iterator[tuple[str, str, Any]]:
    """Yields the three parts with each seed and gripper, in the form of `zoo`."""
    for seed, name, gripper in product(SEEDS, PARTS, GRIPPERS):
        job = job_file.load(TREES / name / "job.toml")
        job = job.replaced(seed=seed, gripper=GRIPPERS[gripper])

        def judged(job: job_file.Job = job) -> dict[str, Any]:
            limit = Limit(budget_s, time.thread_time)
            plan = compile_job(job, workers=1, limit=limit)
            return {**plan.evaluation.summary(), "kind": None, "cut": plan.cut is not None}

        yield f"{name}, seed {seed}", gripper, judged


def main() -> int:
    """Makes the plans that are not in the file of results, and prints the means; returns the exit code."""
    parser = harness.parser(__doc__)
    parser.add_argument("--sample", type=int, default=24, metavar="N")
    parser.add_argument("--budget", type=seconds, default=90.0, help="of planning each")
    parser.add_argument("--cpu", type=seconds, default=2400.0, help="then nothing more is begun")
    given = parser.parse_args()
    rows = RESULTS.read([])
    done = {(row["name"], row["gripper"]) for row in rows}
    for name, gripper, judged in (*zoo(given.sample, given.budget), *parts(given.budget)):
        if (name, gripper) in done or time.process_time() > given.cpu:
            continue
        row = judged()
        figures = {key: row[key] for key in KEPT if key in row}
        if figures.get("error_mm"):
            figures["error_mm"] = round(figures["error_mm"]["median"], 4)
        rows.append({"name": name, "gripper": gripper, **figures})
        RESULTS.write_rows(rows)
        harness.show(rows[-1])
    for title, chosen in (("zoo", None), *((part, part) for part in PARTS)):
        print(title, compared([row for row in rows if part_of(row["name"]) == chosen]))
    return 0


def part_of(name: str) -> str | None:
    """The part in `PARTS` with which the name of a row begins; None for an outline of the zoo."""
    part = name.partition(", seed ")[0]
    return part if part in PARTS else None


def compared(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean figures of each gripper, over the plans that count with both grippers.

    A plan counts if its search was not cut short. The result also has the numbers of plans.
    """
    located = [row for row in rows if row["kind"] is None and not row["cut"]]
    by_gripper = {
        gripper: {row["name"]: row for row in located if row["gripper"] == gripper}
        for gripper in GRIPPERS
    }
    both = set.intersection(*map(set, by_gripper.values()))
    means = {
        gripper: {key: round(mean(by_name[name][key] for name in both), 3) for key in SHOWN if both}
        for gripper, by_name in by_gripper.items()
    }
    located_by = {key: len(by_name) for key, by_name in by_gripper.items()}
    return {"compared": len(both), "located": located_by, **means}


if __name__ == "__main__":
    sys.exit(main())
