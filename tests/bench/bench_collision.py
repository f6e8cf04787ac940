"""How often the collision detector errs, either way; not part of the gate.

    python tests/bench/bench_collision.py [--count 100000]

A detector is learned for each part and judged on fresh placements over the region of roll-outs, with the jaws
fully open and opened anywhere. Prints figures and writes `results/collision.json` beside this file.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from problems import JAWS, OUTLINES  # noqa: E402

from planner.paper.collision import CollisionDetector, exact, placements  # noqa: E402
from planner.part import symmetry  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "collision.json"
RADII_MM = {"rectangle": 38.25, "butterfly": 30.0, "right triangle": 30.0, "L": 30.0, "hexagon": 30.0}
SEEDS = (1, 2, 3)


def bench(name: str, count: int, seed: int) -> dict[str, Any]:
    """One detector and its errors."""
    outline, rng = OUTLINES[name](), np.random.default_rng(seed)
    start = time.perf_counter()
    detector = CollisionDetector.fit(outline, JAWS, symmetry.order(outline), RADII_MM[name], rng)
    row: dict[str, Any] = {"part": name, "seed": seed, "fit_s": time.perf_counter() - start,
                           "margin_mm": detector.margin_mm, "threshold": detector.threshold}  # fmt: skip
    for kind, any_opening in (("fully_open", False), ("any_opening", True)):
        poses, opening = placements(outline, JAWS, RADII_MM[name], count, rng, any_opening)
        confusion = detector.judged(outline, poses, opening)
        row[kind] = {**confusion._asdict(), "miss_rate": confusion.miss_rate,
                     "false_alarm_rate": confusion.false_alarm_rate}  # fmt: skip
    start = time.perf_counter()
    detector.collides(poses, opening)
    middle = time.perf_counter()
    exact(outline, JAWS[1], JAWS[2], poses, opening)
    row["tree_us"] = 1e6 * (middle - start) / count
    row["exact_us"] = 1e6 * (time.perf_counter() - middle) / count
    print(
        f"{name:15} seed {seed}: called free {row['fully_open']['miss_rate']:.4%} and "
        f"{row['any_opening']['miss_rate']:.4%} of the colliding, false alarms "
        f"{row['fully_open']['false_alarm_rate']:.2%} and {row['any_opening']['false_alarm_rate']:.2%}; "
        f"{row['tree_us']:.2f} us a placement, exact {row['exact_us']:.2f} us",
        flush=True,
    )
    return row


def main() -> None:
    """Run the bench and record it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100_000, help="of held-out placements")
    options = parser.parse_args()
    rows = [bench(name, options.count, seed) for name in RADII_MM for seed in SEEDS]
    setting = {"python": platform.python_version(), "machine": platform.machine()}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps({"detectors": rows, "setting": setting}, indent=1) + "\n")


if __name__ == "__main__":
    main()
