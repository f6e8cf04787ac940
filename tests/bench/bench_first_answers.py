"""Checks what `squeezetree try` answers for randomly drawn outlines of tools/zoo500.

    python tests/bench/bench_first_answers.py [--sample 60] [--seed 50] [--budget 60s]

Each outline is written as CSV and tried as by a user, in a separate process. The command must end with exit
code 0 and a verdict, at most `SPARE_S` seconds after the budget of its search. The shares in its answer must
add up to 1, and the success rate must lie in its interval. The sentence must name the weakest world, and
there must be conditions exactly if this world has many wrong answers. The answer must have no notes.

Answers are kept line by line in the file `--results`; a second start continues after them. Figures go to
`results/first_answers.json` beside this file: names and figures, no outlines. If the packages that the
outlines come from are missing, the command says how to get them. Not part of `tools/check`.
"""

import argparse
import json
import platform
import random
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import harness
import zoo_sources
from programs import ROOT, ended

from planner.report.verdict import GOOD_WRONG
from runtime.shell.command import seconds

RESULTS = harness.Kept("first_answers")
# For imports, kernels, other worlds and the picture, on a machine that others use, too.
SPARE_S = 60.0
SHARES = ("success_rate", "wrong_rate", "unresolved_rate", "reject_rate")
KEPT = (*SHARES, "crashes", "mean_squeezes", "verdict")


def main() -> int:
    parser = harness.parser(__doc__)
    add = parser.add_argument
    add("--sample", type=int, default=60, metavar="N", help="outlines")
    add("--seed", type=int, default=50, help="of the draw")
    add("--budget", type=seconds, default=60.0, metavar="60s", help="of each search (default: 60s)")
    add("--turn", default="20", metavar="DEG", help="passed on")
    add("--results", type=Path, default=ROOT / "out" / "first_answers.jsonl", help="what is done")
    options = parser.parse_args()
    outlines = zoo_sources.outlines()
    if not outlines:
        print(f"no outlines; get them with: {zoo_sources.HOW}", file=sys.stderr)
        return 3
    names = random.Random(options.seed).sample(sorted(outlines), min(options.sample, len(outlines)))
    options.results.parent.mkdir(parents=True, exist_ok=True)
    lines = options.results.read_text().splitlines() if options.results.exists() else []
    done = {row["name"]: row for row in map(json.loads, lines)}
    for name in names:
        if name not in done:
            done[name] = answered(name, outlines[name], options)
            with options.results.open("a") as file:
                file.write(json.dumps(done[name]) + "\n")
            harness.show(done[name])
    rows = [done[name] for name in names if name in done]
    figures = {"machine": platform.platform(), "budget_s": options.budget}
    figures |= {"turn_deg": options.turn, "seed": options.seed}
    RESULTS.write({**figures, "drawn": len(names), "of": len(outlines), "rows": rows})
    wrong = [row["name"] for row in rows if row["faults"]]
    print(
        f"{len(rows)} of {len(names)} tried, {len(wrong)} with a fault: {', '.join(wrong) or 'none'}"
    )
    return 1 if wrong else 0


def answered(name: str, outline: Any, options: argparse.Namespace) -> dict[str, Any]:
    """Tries an outline (n, 2) in a separate process; returns the answer's figures and faults."""
    with tempfile.TemporaryDirectory() as folder:
        drawing = Path(folder) / "part.csv"
        drawing.write_text("x_mm,y_mm\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in outline))
        words = [Path(sys.executable).with_name("squeezetree"), "try", "part.csv", "--units", "mm"]
        words += ["--json", "--turn", options.turn, "--budget", f"{options.budget:g}s"]
        began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = ended(words, cwd=folder, timeout=None)
        wall_s, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    row: dict[str, Any] = {"name": name, "seconds": round(wall_s, 1), "cpu_s": round(cpu_s, 1)}
    if done.code:
        return row | {"faults": [f"exit code {done.code}: {done.err.strip()[-300:]}"]}
    answer = json.loads(done.out)
    row |= {key: answer[key] for key in KEPT if key in answer}
    row |= {"reason": answer.get("reason"), "faults": faults(answer, wall_s, options.budget)}
    return row


def faults(answer: dict[str, Any], wall_s: float, budget_s: float) -> list[str]:
    """Describes each fault of an answer in a few words; an empty list means that there is none."""
    wrong = []
    if answer.get("verdict") not in ("good", "fair", "poor", "cut", "unknown"):
        wrong.append("no verdict")
    if wall_s > budget_s + SPARE_S:
        wrong.append(f"{wall_s:.0f} s for a budget of {budget_s:.0f} s")
    if "success_rate" in answer:
        total = sum(answer[key] for key in SHARES) + answer["crashes"] / answer["trials"]
        if abs(total - 1.0) > 1e-9:
            wrong.append(f"shares add up to {total}")
        low, high = answer["success_ci95"]
        if not low <= answer["success_rate"] <= high:
            wrong.append("the rate lies outside its interval")
        weakest = answer["weakest"]
        if bool(answer["conditions"]) != (weakest["wrong"] >= GOOD_WRONG):
            wrong.append("conditions and the weakest world contradict each other")
        if weakest["name"] not in answer["sentence"]:
            wrong.append("the sentence names another world than the weakest")
    wrong += [f"note: {note}" for note in answer.get("notes", ())]
    return wrong


if __name__ == "__main__":
    sys.exit(main())
