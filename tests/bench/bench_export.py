"""What an exported table costs in C: bytes of code, nanoseconds of a decision; and many random calls.

    python tests/bench/bench_export.py [--calls 10000000] [--repeat 20000]

Every table in `trees/`, and one of a node with as many branches as may be, by each of gcc and clang that is
installed: the executor's code with -Os, without the data; a decision at -O2, the mean of all readings and the
slowest one's, each as the mean CPU time of `--repeat` calls; and `--calls` random calls under address and
undefined-behaviour sanitizers. Prints the figures beside their limits and writes `results/export.json`; ends
with 1 where a limit is not kept.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

from exported import SANITIZERS, STRICT, built, code_bytes, compilers, executor, said, wide_table  # noqa: E402

from planner.export.write import VECTORS, write  # noqa: E402
from runtime.table import TableFile, dumps, load  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "export.json"
MOST_CODE_BYTES, MOST_NS = 4096, 1000.0
SEED = 1


def measured(compiler: str, folder: Path, calls: int, repeat: int) -> dict[str, Any]:
    """The figures of one table by one compiler."""
    made = executor(compiler, folder)
    sections = [
        row.split() for row in said("-A", made, program="size").splitlines() if row.startswith(".rodata")
    ]
    fast = built(compiler, folder, *STRICT, "-O2")
    mean_ns, slowest_ns = map(float, said("time", repeat, program=fast).split())
    checked = built(compiler, folder, *STRICT, *SANITIZERS)
    vectors = int(said("check", folder / VECTORS, program=checked))
    outcomes = [int(word) for word in said("fuzz", calls, SEED, program=checked).split()]
    return {
        "compiler": said("--version", program=compiler).splitlines()[0],
        "code_bytes": code_bytes(made),
        "data_bytes": sum(int(row[1]) for row in sections),
        "mean_ns": mean_ns,
        "slowest_ns": slowest_ns,
        "vectors": vectors,
        "random_calls": sum(outcomes),
    }


def main() -> int:
    """Measure all tables; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=10_000_000, help="random calls of each program")
    parser.add_argument("--repeat", type=int, default=20_000, help="calls of each reading for its time")
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    tables = {path.stem: load(path) for path in sorted((ROOT / "trees").glob("*/*.msgpack"))}
    wide = dumps(wide_table())
    tables["32 branches"] = TableFile(wide_table(), wide, hashlib.sha256(wide).hexdigest())
    for name, table in tables.items():
        with tempfile.TemporaryDirectory() as folder:
            write(table, "c99", Path(folder))
            for compiler in compilers():
                row = {
                    "table": name,
                    **measured(compiler, Path(folder), arguments.calls, arguments.repeat),
                }
                print(f"{row['table']}, {row['compiler']}:")
                print(
                    f"  code {row['code_bytes']} bytes of at most {MOST_CODE_BYTES}, data {row['data_bytes']}"
                )
                print(
                    f"  decision {row['mean_ns']:.1f} ns, slowest {row['slowest_ns']:.1f} of {MOST_NS:.0f} ns"
                )
                print(
                    f"  {row['vectors']} vectors equal, {row['random_calls']} random calls without a finding"
                )
                rows.append(row)
    told = {"machine": platform.machine(), "tables": rows}
    RESULTS.write_text(json.dumps(told, indent=1) + "\n")
    kept = all(row["code_bytes"] < MOST_CODE_BYTES and row["slowest_ns"] < MOST_NS for row in rows)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
