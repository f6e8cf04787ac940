"""Evaluates every table of trees/ in the rigid-body world, and repeats its squeezes in the contact world.

    python tests/bench/bench_second_opinion.py [--parts ratchet ...] [--trials 300]

Needs the extra `mujoco`. A part without a table in trees/ is compiled first, and its table is kept. Each
squeeze of the trials is repeated in the contact world: once with nominal parameters, and 20 times with random
ones. Prints figures and writes `results/second_opinion.json` beside this file after each part; rows of other
parts stay in it. Not part of `tools/check`.
"""

import platform
import time
from typing import Any

import harness
import numpy as np
from tree_tables import NAMES, TREES, table_of

from planner.evaluation.evaluate import evaluate
from planner.evaluation.leaves import worst
from planner.evaluation.mujoco import RigidWorld
from planner.frames import wrap
from planner.job import model as job_file
from planner.job.model import Job
from planner.mechanics.simulator import STATUS_NAMES, RollOut, Simulator
from planner.work.scheduler import Threads

RESULTS = harness.Kept("second_opinion")
SEED = 99
DRAWS = 20
KEPT = ("trials", "success_rate", "wrong_rate", "reject_rate", "unresolved_rate", "crashes")
KEPT += ("mean_squeezes",)
NEAR_MM, NEAR_WIDTH_MM = 1.0, 0.5


class Recorder:
    """A rigid-body world that keeps the start and the result of each squeeze."""

    def __init__(self, job: Job) -> None:
        self.world = RigidWorld(job, SEED)
        self.collides = self.world.collides
        self.poses, self.ends = [], []

    def squeeze(self, pose: tuple[float, float, float]) -> Any:
        end = self.world.squeeze(pose)
        self.poses.append(pose)
        self.ends.append((*end[0], end[1], STATUS_NAMES.index(end[2])))
        return end


def near(ends: np.ndarray, rolled: RollOut) -> np.ndarray:
    """Mask (n,) of the squeezes that end alike in both worlds: in place, angle and width."""
    off = ends[:, :3] - rolled.poses
    place = np.hypot(off[:, 0], off[:, 1])
    wide = np.abs(ends[:, 3] - rolled.width_mm)
    return (place < NEAR_MM) & (np.abs(wrap(off[:, 2])) < 0.05) & (wide < NEAR_WIDTH_MM)


def bench(part: str, trials: int) -> dict[str, Any]:
    """Evaluates a part's table in the rigid-body world, repeats its squeezes; returns a row of figures."""
    job, table = job_file.load(TREES / part / "job.toml"), table_of(part, workers=1).table
    world = Recorder(job)
    start = time.process_time()
    evaluation = evaluate(table, job, world, trials, SEED, Threads(1))
    seconds = time.process_time() - start
    poses, ends = np.array(world.poses), np.array(world.ends)
    ours, rng = Simulator.of_job(job, workers=1), np.random.default_rng(SEED)
    middle = 0.5 * (job.friction.finger_part_min + job.friction.finger_part_max)
    nominal = ours.roll_out(poses, ours.nominal(len(poses), middle))
    predicted = np.zeros(len(poses), bool)
    for _ in range(DRAWS):
        predicted |= near(ends, ours.roll_out(poses, ours.sample(len(poses), rng)))
    figures = evaluation.summary()
    row: dict[str, Any] = {
        "part": part,
        **{key: figures[key] for key in KEPT},
        "planned": table.predicted.success_ppm / 1e6,
        "squeezes": len(poses),
        "as_nominal": float(near(ends, nominal).mean()),
        "predicted": float(predicted.mean()),
        "width_p90_mm": float(np.quantile(np.abs(ends[:, 3] - nominal.width_mm), 0.9)),
        "same_status": float((ends[:, 4] == nominal.status).mean()),
        "per_second": len(poses) / seconds,
        "wrong": [row.figures() for row in worst(table, evaluation, int(evaluation.wrong.sum()))],
    }
    harness.show(row)
    return row


def main() -> None:
    parser = harness.parser(__doc__)
    parser.add_argument("--parts", nargs="+", choices=NAMES, default=NAMES, metavar="PART")
    parser.add_argument("--trials", type=int, default=300, help="parts of each")
    options = parser.parse_args()
    for part in options.parts:
        row = bench(part, options.trials)
        others = [old for old in RESULTS.read({"rows": []})["rows"] if old["part"] != part]
        rows = sorted([*others, row], key=lambda row: row["part"])
        record = {"machine": platform.platform(), "rows": rows}
        RESULTS.write(record)


if __name__ == "__main__":
    main()
