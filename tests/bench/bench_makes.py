"""Runs many parts through grasp-runtime with the simulated gripper of each make.

    python tests/bench/bench_makes.py [--parts 1000] [--tree T.msgpack] [MODEL ...]

The simulated gripper speaks the protocol of its make, in virtual time. With `--tree`, the table's gripper
runs alone; without it, each gripper rehearses the small table of the tests. Prints one JSON object for each
gripper: outcomes, crashes, incidents on the line, simulated seconds a part. Ends with 1 if a part was
rejected or ended in a fault. Not part of `tools/check`.
"""

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path
from statistics import mean

import harness
from programs import REHEARSAL, RUNTIME, VIRTUAL, ended
from sample_tables import table_for

from drivers.sim.grippers import SIMULATORS
from runtime.table import dump, load


def run(tree: Path, parts: int, *arguments: str) -> list[dict]:
    """Runs parts through grasp-runtime; returns them as its `--json` prints them."""
    words = ["--journal", tree.with_suffix(".jsonl"), "--count", parts, "--json", *arguments]
    done = ended([*RUNTIME, "--tree", tree, *VIRTUAL, *words], timeout=None)
    return [json.loads(line) for line in done.out.splitlines()]


def figures(model: str, parts: list[dict], journal: Path) -> dict:
    """The figures of a run: outcomes, crashes, incidents, and mean squeezes and seconds of a part."""
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
    """Runs each gripper and prints its figures; returns the exit code."""
    parser = harness.parser(__doc__)
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
                world = REHEARSAL
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
