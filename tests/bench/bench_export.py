"""Checks and times exported tables of the jobs in trees/, in C and in structured text.

    python tests/bench/bench_export.py [--parts ratchet ...] [--calls 10000000] [--repeat 2000]

A part without a table in trees/ is compiled first, and its table is kept in `out/tables-12`. One more table
has a node with as many branches as are allowed.

The vectors of each export are compared with the decisions of the runtime, with the structured text in the
tests' interpreter, and with the C program of each installed compiler (gcc, clang). The C programs run under
sanitizers of addresses and undefined behaviour, and also answer `--calls` random calls.

Two figures have limits: the size of the executor's code with -Os, without the data, and the time of a
decision at -O2 for the slowest reading. The mean over all readings is printed, too. Each time is the mean CPU
time of `--repeat` calls.

Prints the figures beside their limits and writes `results/export.json` beside this file; rows of tables that
are not measured again stay. Ends with 1 if a limit is exceeded. Not part of `tools/check`.
"""

import hashlib
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

import harness
from exported import (
    SANITIZERS,
    STRICT,
    Oracle,
    built,
    check_structured_text,
    code_bytes,
    compilers,
    executor,
    rows_of,
    said,
    wide_table,
)
from structured_text import FunctionBlock
from tree_tables import NAMES, table_of

from planner.export.write import FORMS, VECTORS, write
from runtime.table import Table, TableFile, dumps

RESULTS = harness.Kept("export")
MOST_CODE_BYTES, MOST_NS = 4096, 1000.0
SEED = 1
WIDE = "32 branches"


def proved(table: Table, folder: Path) -> int:
    """Checks all vectors against the runtime's decisions and the structured text; returns their number."""
    rows = rows_of(folder / "st")
    oracle = Oracle(table)
    assert [row[3:] for row in rows] == [oracle.answer(*row[:3]) for row in rows]
    block = FunctionBlock((folder / "st" / FORMS["st"][0]).read_text())
    check_structured_text(block, table, rows)
    return len(rows)


def measured(compiler: str, folder: Path, calls: int, repeat: int) -> dict[str, Any]:
    """Builds an export in C with one compiler, checks it and times it; returns sizes, times and calls."""
    executable = executor(compiler, folder)
    rows = said("-A", executable, program="size").splitlines()
    sections = [row.split() for row in rows if row.startswith(".rodata")]
    fast = built(compiler, folder, *STRICT, "-O2")
    mean_ns, slowest_ns = map(float, said("time", repeat, program=fast).split())
    checked = built(compiler, folder, *STRICT, *SANITIZERS)
    vectors = int(said("check", folder / VECTORS, program=checked))
    outcomes = [int(word) for word in said("fuzz", calls, SEED, program=checked).split()]
    return {
        "compiler": said("--version", program=compiler).splitlines()[0],
        "code_bytes": code_bytes(executable),
        "data_bytes": sum(int(row[1]) for row in sections),
        "mean_ns": mean_ns,
        "slowest_ns": slowest_ns,
        "vectors": vectors,
        "random_calls": sum(outcomes),
    }


def bench(name: str, calls: int, repeat: int) -> dict[str, Any]:
    """Exports one table, checks it in C and structured text, and times it; returns a row of the results."""
    wide = dumps(wide_table())
    digest = hashlib.sha256(wide).hexdigest()
    result = TableFile(wide_table(), wide, digest) if name == WIDE else table_of(name)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write(result, "st", folder / "st")
        vectors = proved(result.table, folder)
        write(result, "c99", folder / "c99")
        c99 = [measured(compiler, folder / "c99", calls, repeat) for compiler in compilers()]
    assert {row["vectors"] for row in c99} == {vectors} == {512 * len(result.table.nodes)}
    nodes = len(result.table.nodes)
    print(f"{name}: {nodes} nodes, {vectors} vectors equal in C and in structured text")
    for row in c99:
        print(
            f"  {row['compiler']}: code {row['code_bytes']} bytes of at most {MOST_CODE_BYTES}, "
            f"data {row['data_bytes']}; decision {row['mean_ns']:.1f} ns, slowest {row['slowest_ns']:.1f} of "
            f"{MOST_NS:.0f} ns; {row['random_calls']} random calls without a finding",
            flush=True,
        )
    return {"table": name, "nodes": len(result.table.nodes), "st_vectors": vectors, "c99": c99}


def main() -> int:
    """Measures all chosen tables; returns the exit code."""
    parser = harness.parser(__doc__)
    names = [*NAMES, WIDE]
    parser.add_argument("--parts", nargs="+", choices=names, default=names, metavar="PART")
    parser.add_argument("--calls", type=int, default=10_000_000, help="random ones of each program")
    parser.add_argument("--repeat", type=int, default=2_000, help="calls of a reading for its time")
    options = parser.parse_args()
    record = RESULTS.read({"tables": []})
    rows = {row["table"]: row for row in record["tables"]}
    for name in options.parts:
        rows[name] = bench(name, options.calls, options.repeat)
        record = {"machine": platform.machine(), "tables": [rows[key] for key in sorted(rows)]}
        RESULTS.write(record)
    figures = [figure for row in rows.values() for figure in row["c99"]]
    small = all(row["code_bytes"] < MOST_CODE_BYTES for row in figures)
    return 0 if small and all(row["slowest_ns"] < MOST_NS for row in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
