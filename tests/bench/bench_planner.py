"""Plans every job of `trees/` with several seeds, by one planner or several; not part of `tools/check`.

    python tests/bench/bench_planner.py                                    this checkout, ten seeds
    python tests/bench/bench_planner.py --only rectangle wedge --seeds 1 2
    python tests/bench/bench_planner.py --planner now=. --planner before=../before
    python tests/bench/bench_planner.py --report                           only print what is kept

A planner is a checkout with an environment in its `.venv` (`tools/demo` makes one); its `plan-compile` plans
the jobs of this checkout on one thread. A plan is judged by 20 000 parts that were not used in planning.
Seconds are processor seconds of the whole process. Each plan is kept in `results/planner.json` beside this
file as soon as it is made; plans that are kept are not made again.
"""

import json
import os
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean

import harness
from programs import ROOT, TREES

RESULTS = harness.Kept("planner")
JOBS = {path.parent.name: path for path in sorted(TREES.glob("*/job.toml"))}
SEEDS = range(1, 11)


@dataclass(frozen=True)
class Plan:
    """The figures of one plan, and the processor time that planning took."""

    planner: str
    part: str
    seed: int
    squeezes: float
    success: float
    wrong: float
    nodes: int
    cpu_s: float

    @property
    def total(self) -> float:
        """Mean squeezes, plus 100 times the share of parts that are not located."""
        return self.squeezes + 100.0 * (1.0 - self.success)


def planned(planner: str, checkout: Path, part: str, seed: int) -> Plan:
    """Plans a part by a planner's checkout in a separate process; returns the plan's figures."""
    with tempfile.TemporaryDirectory() as folder:
        command = [checkout / ".venv" / "bin" / "plan-compile", JOBS[part]]
        command += ["-o", f"{folder}/t.msgpack", "--seed", str(seed)]
        command += ["--workers", "1", "--no-advice", "--json"]
        with Path(folder, "json").open("wb") as output:
            streams = {"stdout": output, "stderr": subprocess.DEVNULL}
            process = subprocess.Popen(command, cwd=checkout, **streams)
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said = f"plan-compile ended with {process.returncode}"
            raise SystemExit(f"{planner}, {part}, seed {seed}: {said}")
        figures = json.loads(Path(folder, "json").read_text())
    rates = (figures[name] for name in ("mean_squeezes", "success_rate", "wrong_rate", "nodes"))
    return Plan(planner, part, seed, *rates, round(usage.ru_utime + usage.ru_stime, 2))


def kept() -> list[Plan]:
    """The plans of former runs, from the file of results."""
    return [Plan(**row) for row in RESULTS.read([])]


def keep(plans: Iterable[Plan]) -> None:
    """Writes all plans to the file of results, one a line."""
    rows = sorted(plans, key=lambda plan: (plan.planner, plan.part, plan.seed))
    RESULTS.write_rows([asdict(row) for row in rows])


def report(plans: list[Plan]) -> None:
    """Prints means and spread of the plans: a row for each part and planner, and one for all parts."""
    print(
        f"{'part':16} {'planner':8} {'seeds':>5}  squeezes (spread)  success    wrong  total    cpu s"
    )
    for part in [*sorted({plan.part for plan in plans}), "all"]:
        for planner in sorted({plan.planner for plan in plans}):
            rows = [p for p in plans if p.planner == planner and part in (p.part, "all")]
            if not rows:
                continue
            spread = fmean(
                max(squeezes) - min(squeezes)
                for name in {row.part for row in rows}
                if (squeezes := [row.squeezes for row in rows if row.part == name])
            )
            print(
                f"{part:16} {planner:8} {len(rows):5}  {fmean(p.squeezes for p in rows):8.3f} "
                f"({spread:.3f})   {fmean(p.success for p in rows):.5f} {fmean(p.wrong for p in rows):.5f} "
                f"{fmean(p.total for p in rows):6.3f} {fmean(p.cpu_s for p in rows):8.1f}"
            )


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("--only", nargs="+", choices=JOBS, default=list(JOBS), help="these parts")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    said = "a planner (default: now=this checkout)"
    parser.add_argument("--planner", action="append", metavar="NAME=CHECKOUT", help=said)
    parser.add_argument("--report", action="store_true", help="plan nothing, print what is kept")
    arguments = parser.parse_args()
    planners = dict(text.split("=", 1) for text in arguments.planner or [f"now={ROOT}"])
    plans = {(plan.planner, plan.part, plan.seed): plan for plan in kept()}
    for seed in arguments.seeds if not arguments.report else []:
        for part in arguments.only:
            for planner, checkout in planners.items():
                if (planner, part, seed) not in plans:
                    plan = planned(planner, Path(checkout).resolve(), part, seed)
                    plans[planner, part, seed] = plan
                    keep(plans.values())
                    print(plan, flush=True)
    report(list(plans.values()))


if __name__ == "__main__":
    main()
