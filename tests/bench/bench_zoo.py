"""Plans and judges a fixed sample of the outlines of tools/zoo500, before a release.

    python tests/bench/bench_zoo.py [--sample 20] [--budget 120s] [--done]

Prints a line for each outline and writes `results/zoo500.json` beside this file: names and figures, no
outlines. With `--done` it continues after the outlines that tools/zoo500 has done. If the packages that the
outlines come from are missing, the command says how to get them. Not part of `tools/check`.
"""

import json
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import harness
from programs import ROOT

RESULTS = harness.Kept("zoo500")
DONE = ROOT / "out" / "zoo500.jsonl"


def main() -> int:
    parser = harness.parser(__doc__)
    parser.add_argument("--sample", default="20", metavar="N", help="how many outlines")
    parser.add_argument("--budget", default="120s", help="of planning each")
    parser.add_argument("--done", action="store_true", help="go on from what tools/zoo500 has done")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lines = DONE if options.done else Path(folder) / "rows.jsonl"
        page = Path(folder) / "page.html"
        words = [sys.executable, str(ROOT / "tools" / "zoo500"), "--sample", options.sample]
        words += ["--workers", "1", "--budget", options.budget, "--results", str(lines)]
        if code := subprocess.call([*words, "-o", str(page)]):
            return code
        rows = {row["name"]: row for row in map(json.loads, lines.read_text().splitlines())}
    for row in rows.values():
        del row["outline_mm"], row["key"]
    record = {"machine": platform.platform(), "budget": options.budget, "rows": list(rows.values())}
    RESULTS.write(record)
    return 0


if __name__ == "__main__":
    sys.exit(main())
