"""How often the verdict of `grasp-audit study` is wrong, looked at after each part; not part of the gate.

    python tests/bench/bench_acceptance.py [--cells 1000] [--parts 4000]

Prints figures and writes `results/acceptance.json` beside this file. Each cell has a true share of failures
and runs until its first verdict: shares spread evenly, on a logarithmic scale, from a quarter of the limit to
four times it; and shares at the limit itself, where either verdict counts as wrong, which is the worst case.
Some parts are stopped by the operator, and of some the audit tells nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import numpy as np  # noqa: E402
from acceptance_cells import tried  # noqa: E402

from runtime.spc.study.acceptance import ERROR, planned  # noqa: E402
from runtime.table import wilson_interval  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "acceptance.json"
SEED = 0x41434345
SPREAD, AT_LIMIT = "a quarter to four times the limit", "at the limit"


def measure(kind: str, limit: float, unseen: float, cells: int, parts: int) -> dict[str, Any]:
    """Verdicts on so many cells of a kind."""
    counted: Counter[str] = Counter()
    for cell in range(cells):
        rng = np.random.default_rng(
            [SEED, round(1e6 * limit), round(1e6 * unseen), cell, kind == AT_LIMIT]
        )
        rate = limit if kind == AT_LIMIT else float(limit * 4.0 ** rng.uniform(-1.0, 1.0))
        counted[tried(rng, rate, limit, parts, unseen).value] += 1
    wrong = counted["wrong"]
    return {
        "shares": kind,
        "limit": limit,
        "not_known": unseen,
        "cells": cells,
        "parts_at_most": parts,
        **{word: counted[word] for word in ("right", "wrong", "open")},
        "coverage": 1.0 - wrong / cells,
        "wrong_ci95": list(wilson_interval(wrong, cells)),
    }


def main() -> None:
    """Measure all kinds, print them and keep them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=1000)
    parser.add_argument("--parts", type=int, default=4000)
    arguments = parser.parse_args()
    rows = []
    for limit in (0.05, 0.01):
        for kind in (SPREAD, AT_LIMIT):
            for unseen in (0.0, 0.02):
                row = measure(kind, limit, unseen, arguments.cells, arguments.parts)
                rows.append(row)
                print(json.dumps(row), flush=True)
    counts = {str(limit): planned(limit, limit / 5.0)._asdict() for limit in (0.05, 0.01, 0.001)}
    kept = {"error_allowed": ERROR, "rows": rows, "parts_where_a_fifth_of_the_limit_fails": counts}
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
