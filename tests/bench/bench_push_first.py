"""Would a push before the first squeeze pay? The large disc of Table I's rows 5 to 8; not part of the gate.

    python tests/bench/bench_push_first.py [--parts 20000]

Some parts lie where an open finger comes down. Closed fingers can push them inwards before the first
squeeze, from both sides, by the mechanics of `plan-simulate --push`. Prints how many parts that saves and
what it takes, and writes `results/push_first.json` beside this file.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]

from planner.belief.particles import initial  # noqa: E402
from planner.frames import to_hand  # noqa: E402
from planner.job import model as job_file  # noqa: E402
from planner.mechanics.clearance import STANDS_ON, classify_contact  # noqa: E402
from planner.mechanics.push import Paths  # noqa: E402
from planner.mechanics.simulator import Simulator  # noqa: E402
from planner.part.outline import reach  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "push_first.json"
JOB = ROOT / "trees" / "rectangle-25" / "job.toml"
SEED = 7
POINTS = 12  # of the pusher's face
SPARE_MM = 1.0  # how much farther inwards than the open fingers it goes


def pushed(part: Simulator, poses: np.ndarray, side: float, rng: np.random.Generator) -> np.ndarray:
    """Where parts (n, 3) lie after closed fingers came in along y from one side, x being their length."""
    opening, length = part.jaws[0], part.jaws[1]
    begin = reach(part.outline) + float(np.hypot(*poses[:, :2].T).max()) + SPARE_MM
    way = begin - (0.5 * opening - SPARE_MM)
    face = np.column_stack(
        [np.linspace(-0.5, 0.5, POINTS) * (length + 2 * SPARE_MM), np.full(POINTS, -side * begin)]
    )
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    inverse = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)  # (n, 2, 2)
    points = np.einsum("nij,nkj->nki", inverse, face[None] - poses[:, None, :2])
    shifts = inverse @ np.array([0.0, side * way])
    n = len(poses)
    moved = part.push(Paths(points, np.zeros((n, 2)), np.zeros(n), shifts), part.sample(n, rng)).moved
    after = poses.copy()
    after[:, :2] += np.einsum("nji,nj->ni", inverse, moved[:, :2])
    after[:, 2] += moved[:, 2]
    return after


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--parts", type=int, default=20_000, help="default: %(default)s")
    options = parser.parse_args()
    job, rng = job_file.load(JOB), np.random.default_rng(SEED)
    part = Simulator.of_job(job)
    poses = initial(job, options.parts, rng)
    hands = [
        np.array([x, y, math.radians(a)]) for a in job.actions.angles_deg for x, y in job.actions.centers_mm
    ]
    before = min(
        int((classify_contact(part.outline, part.jaws, to_hand(poses, hand)) == STANDS_ON).sum())
        for hand in hands
    )
    after = pushed(part, pushed(part, poses, 1.0, rng), -1.0, rng)
    left = int((classify_contact(part.outline, part.jaws, after) == STANDS_ON).sum())
    cell, gripper = job.cell, job.gripper
    begin = reach(part.outline) + job.uncertainty.radius_mm + SPARE_MM
    lift_s = 2.0 * (cell.retreat_height_mm - cell.squeeze_height_mm) / cell.arm_speed_mm_s
    push_s = (begin - 0.5 * gripper.opening_mm + SPARE_MM) / gripper.speed_mm_s
    seconds = 2.0 * (lift_s + push_s) + 4.0 * begin / cell.arm_speed_mm_s
    saved = (before - left) / options.parts
    figures = {
        "parts": options.parts, "under_a_finger": before, "after_two_pushes": left,
        "moved_share": float((np.abs(after - poses).max(axis=1) > 0.1).mean()),
        "seconds_of_two_pushes": seconds,
        "seconds_for_each_part_saved": seconds / saved if saved > 0 else None,
    }  # fmt: skip
    print(json.dumps(figures))
    RESULTS.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
