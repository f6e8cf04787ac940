"""Seconds a part: the forecast of tables against the simulated cell in virtual time.

    python tests/bench/bench_seconds.py TREE.msgpack [TREE.msgpack ...] [--count 500] [--trials 20000]

The forecast is that of `plan-evaluate`: fresh trials, timed by the table's model of time. The other side is
`grasp-runtime --port sim --time-scale max`, whose devices take their own times. Writes `results/seconds.json`
and prints it as a table.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from statistics import fmean

from planner.evaluation.evaluate import evaluate
from planner.job import model as job_file
from planner.world import ContactWorlds
from runtime.table import load, takt_figures

ROOT = Path(__file__).parents[2]
RESULTS = Path(__file__).parent / "results" / "seconds.json"
SEED = 52
REJECTED, UNRESOLVED = 10, 11  # exit codes of runs whose parts all came to an outcome

sys.path.insert(0, str(ROOT / "tools" / "docs" / "site"))

from kept import table_of  # noqa: E402

Figures = dict[str, float]


def forecast(tree: Path, trials: int) -> Figures:
    """What the table says that parts will take."""
    table = load(tree).table
    job = job_file.from_canonical(str(table.job))
    summary = evaluate(table, job, ContactWorlds.of_job(job, SEED), trials, SEED).summary()
    return _timed(summary, summary["trials"], summary["mean_squeezes"])


def measured(tree: Path, count: int) -> Figures:
    """What parts take in the simulated cell.

    Raises:
        SystemExit: the run ended with a fault.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "runtime.cli", "--tree", str(tree.resolve()), "--json"]
        command += ["--port", "sim", "--time-scale", "max", "--count", str(count)]
        command += ["--seed", str(SEED), "--journal", str(Path(folder) / "journal.jsonl")]
        run = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, check=False)
    if run.returncode not in (0, REJECTED, UNRESOLVED):
        raise SystemExit(f"{tree}: the run ended with exit code {run.returncode}: {run.stderr}")
    parts = [json.loads(line) for line in run.stdout.splitlines()]
    summary = takt_figures(Counter(part["seconds"] for part in parts))
    return _timed(summary, len(parts), fmean(len(part["path"]) for part in parts))


def _timed(summary: Figures, parts: int, squeezes: float) -> Figures:
    times = {name: round(value, 4) for name, value in summary.items() if "seconds_" in name}
    return {"parts": parts, "squeezes": squeezes, **times}


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("trees", type=Path, nargs="+", metavar="TREE.msgpack")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--trials", type=int, default=20_000)
    given = parser.parse_args()
    rows = []
    for tree in given.trees:
        rows.append(
            {
                "part": tree.stem,
                "forecast": forecast(tree, given.trials),
                "measured": measured(tree, given.count),
            }
        )
        RESULTS.write_text(json.dumps(rows, indent=1) + "\n")
    print(table_of("seconds"))


if __name__ == "__main__":
    main()
