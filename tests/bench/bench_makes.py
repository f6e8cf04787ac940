"""Many parts through grasp-runtime with each make of gripper; not part of the gate.

    python tests/bench/bench_makes.py [--parts 1000] [--tree T.msgpack] [MODEL ...]

The simulated cell's gripper answers the make's own bytes, in virtual time. Prints one JSON object a gripper:
outcomes, crashes, incidents on the line, simulated seconds a part. Ends with 1 where a part was rejected, or
ended in a fault. Without a table the small one of the tests is rehearsed.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from statistics import mean

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from gripper_tables import table_for  # noqa: E402

from drivers.sim.grippers import SIMULATORS  # noqa: E402
from runtime.table import dump, load  # noqa: E402


def run(tree: Path, parts: int, *arguments: str) -> list[dict]:
    """The parts of a run."""
    command = [sys.executable, "-m", "runtime.cli", "--tree", str(tree), "--port", "sim", "--json"]
    command += ["--journal", str(tree.with_suffix(".jsonl")), "--count", str(parts)]
    command += ["--time-scale", "max", *arguments]
    out = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout
    return [json.loads(line) for line in out.splitlines()]


def figures(model: str, parts: list[dict], journal: Path) -> dict:
    """What a run came to."""
    text = journal.read_text(encoding="utf-8")
    return {
        "model": model,
        "parts": len(parts),
        "outcomes": dict(Counter(part["outcome"] for part in parts)),
        "crashes": sum(part["crashes"] or 0 for part in parts),
        "incidents": text.count('"incident"'),
        "squeezes_a_part": round(mean(len(part["path"]) for part in parts), 3),
        "seconds_a_part": round(mean(part["seconds"] for part in parts), 3),
    }


def main() -> int:
    """Run each gripper."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=int, default=1000)
    parser.add_argument("--tree", type=Path, help="its gripper alone, in the planner's world")
    parser.add_argument("models", nargs="*", default=list(SIMULATORS))
    given = parser.parse_args()
    bad = False
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name) / "t.msgpack"
        models = given.models if given.tree is None else [load(given.tree).table.gripper.model]
        for model in models:
            if given.tree is None:
                dump(table_for(model), tree)
                world = ("--world", "runtime.devices.rehearsal:make")
            else:
                tree.write_bytes(given.tree.read_bytes())
                world = ()
            tree.with_suffix(".jsonl").unlink(missing_ok=True)
            row = figures(model, run(tree, given.parts, *world), tree.with_suffix(".jsonl"))
            print(json.dumps(row), flush=True)
            located = sum(row["outcomes"].get(kind, 0) for kind in ("leaf", "unresolved"))
            bad = bad or located != given.parts
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
