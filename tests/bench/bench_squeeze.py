"""Measures how well squeezes converge, and how fast they are computed beside scipy and MuJoCo.

    python tests/bench/bench_squeeze.py [--poses 2000] [--only convergence goldberg speed compile]

Prints tables and writes `results/squeeze.json` beside this file. The speed of MuJoCo is measured if the extra
`mujoco` is installed. Not part of `tools/check`.
"""

import argparse
import math
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import harness
import numpy as np
from problems import (
    JAWS,
    LONG_JAWS,
    OUTLINES,
    deepest_overlap,
    random_convex,
    random_poses,
    simulator,
)
from programs import JOB, ROOT, ended
from twin import Part, squeeze

from planner.job import model as job_file
from planner.mechanics.simulator import DEFAULT_STEP_MM, STATUS_NAMES
from planner.part.outline import width as outline_width

RESULTS = harness.Kept("squeeze")
RADII_MM = (12.75, 38.25)
FINER = 20
CLOSE_MM, CLOSE_DEG = 0.3, 1.0
Row = dict[str, Any]

FIRST_CALL = """
import time; start = time.perf_counter()
import numpy as np
from planner.mechanics.clearance import Jaws
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.simulator import Simulator
outline = np.array([[-15, -10.5], [15, -10.5], [15, 10.5], [-15, 10.5]])
jaws = Jaws(85.0, 27.5, 9.5, 0.5)
part = Simulator(outline, LimitSurface(np.diag([1.05, 1.06, 0.58]), 10.6), jaws, (0.4, 0.6), 100)
imported = time.perf_counter()
part.roll_out(np.zeros((1, 3)), part.nominal(1, 0.5))
print(time.perf_counter() - imported, imported - start)
"""


def convergence(poses: int) -> list[Row]:
    """Compares squeezes at the default step with squeezes at a step 20 times finer.

    Returns:
        A row for each outline and each disc of initial positions; friction and limit surfaces are random.
    """
    table = []
    for name, make in OUTLINES.items():
        outline = make()
        for radius in RADII_MM:
            row: Row = {"part": name, "disc_mm": radius} | _converged(outline, radius, poses)
            table.append(row)
            harness.show(row)
    return table


def _converged(outline: np.ndarray, radius: float, poses: int) -> Row:
    rng = np.random.default_rng(5)
    start = random_poses(rng, poses, radius)
    coarse = simulator(outline)
    fine = simulator(outline, step_mm=DEFAULT_STEP_MM / FINER, workers=os.cpu_count() or 1)
    parameters = coarse.sample(poses, rng)
    coarse.roll_out(start[:1], coarse.nominal(1, 0.5))  # compiled before the clock starts
    clock = time.perf_counter()
    result = coarse.roll_out(start, parameters)
    seconds = time.perf_counter() - clock
    exact = fine.roll_out(start, parameters)
    offset = result.poses - exact.poses
    close = (
        (np.hypot(offset[:, 0], offset[:, 1]) < CLOSE_MM)
        & (np.abs(np.degrees(offset[:, 2])) < CLOSE_DEG)
        & (np.abs(result.width_mm - exact.width_mm) < CLOSE_MM)
    )
    depths = [
        deepest_overlap(outline, after, width)
        for before, after, width in zip(start, result.poses, result.width_mm, strict=True)
        if deepest_overlap(outline, before, JAWS.opening_mm) == 0.0
    ]
    counts = np.bincount(result.status, minlength=4).tolist()
    return {
        "close_percent": 100 * float(close.mean()),
        "deepest_mm": max(depths),
        "given_up": int(result.given_up.sum()),
        "given_up_fine": int(exact.given_up.sum()),
        "per_second": poses / seconds,
        "statuses": dict(zip(STATUS_NAMES, counts, strict=True)),
        "first_given_up": start[np.flatnonzero(result.given_up)[:3]].tolist(),
        "first_off": start[np.flatnonzero(~close)[:3]].tolist(),
    }


def goldberg() -> Row:
    """Squeezes random convex polygons without friction; counts those that end at a local minimum of width."""
    polygons, poses, ended, held = 200, 10, 0, 0
    for seed in range(polygons):
        rng = np.random.default_rng(seed)
        outline = random_convex(rng, int(rng.integers(4, 9)))
        part = simulator(outline, LONG_JAWS)
        result = part.roll_out(random_poses(rng, poses, 10.0), part.nominal(poses, 0.0))
        held += int((np.array(STATUS_NAMES)[result.status] == "grasped").sum())
        for pose, width in zip(result.poses, result.width_mm, strict=True):
            axis = math.pi / 2 - pose[2]
            near = axis + np.radians(np.linspace(-1.0, 1.0, 201))
            floor = min(outline_width(outline, angle) for angle in near)
            ended += abs(floor - width) < 0.02
    row: Row = {"polygons": polygons, "squeezes": polygons * poses}
    row |= {"in_a_valley": int(ended), "grasped": held}
    harness.show(row)
    return row


def speed() -> list[Row]:
    """Measures squeezes a second on one core, and the ratios to those of scipy and MuJoCo."""
    table = []
    for name, count in (("rectangle", 20_000), ("butterfly", 10_000)):
        outline = OUTLINES[name]()
        part = simulator(outline)
        rng = np.random.default_rng(6)
        poses = random_poses(rng, count, RADII_MM[0])
        parameters = part.sample(count, rng)
        part.roll_out(poses[:10], part.nominal(10, 0.5))
        ours = count / min(_timed(lambda: part.roll_out(poses, parameters)) for _ in range(3))  # noqa: B023
        row = {"part": name, "vertices": len(outline), "per_second": ours}
        table.append(row | _others(part, poses[:20], ours))
        harness.show(table[-1])
    return table


def _others(part: Any, poses: np.ndarray, ours: float) -> Row:
    """Squeezes poses by the scipy twin and by MuJoCo; compares speeds and results with ours."""
    nominal = part.roll_out(poses, part.nominal(len(poses), 0.5))
    model = Part(part.outline, part.surface.A, part.surface.rho_mm, 0.5, JAWS)
    clock = time.perf_counter()
    few = [squeeze(model, pose) for pose in poses[:5]]
    twin = 5 / (time.perf_counter() - clock)
    off_mm = np.abs([r.width_mm for r in few] - nominal.width_mm[:5]).max()
    row: Row = {"twin_per_second": twin, "times_twin": ours / twin}
    row["twin_width_error_mm"] = float(off_mm)
    try:
        from planner.evaluation.mujoco import RigidWorld
    except ImportError:
        print(
            "MuJoCo is not installed: its speed is not measured (pip install 'squeezetree[mujoco]')"
        )
        return row
    drawn = {"outline_mm": part.outline.tolist(), "symmetry": 1}
    world = RigidWorld(job_file.load(JOB).replaced(part=drawn), 0)
    clock = time.perf_counter()
    results = [(world.close(tuple(pose), 0.5), world.pose()) for pose in poses.tolist()]
    mujoco = len(poses) / (time.perf_counter() - clock)
    widths, ends = np.array([width for width, _ in results]), np.array([end for _, end in results])
    offset = np.hypot(*(ends - nominal.poses)[:, :2].T)
    near = (np.abs(widths - nominal.width_mm) < 1.0) & (offset < 1.0)
    return row | {
        "mujoco_per_second": mujoco,
        "times_mujoco": ours / mujoco,
        "mujoco_within_1_mm": f"{near.sum()} of {len(near)}",
    }


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def first_call() -> Row:
    """Measures how long a process takes for its first squeeze, with an empty and a filled kernel cache."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"SQUEEZETREE_CACHE_DIR": folder, "PYTHONPATH": str(ROOT)}
        for _ in range(2):
            done = ended([sys.executable, "-c", FIRST_CALL], env=environment, timeout=None)
            seconds.append(float(done.out.split()[0]))
    row: Row = {"empty_cache_s": seconds[0], "filled_cache_s": seconds[1]}
    harness.show(row)
    return row


def main() -> None:
    """Runs the chosen studies and adds their figures to the file of results."""
    parser = harness.parser(__doc__)
    parser.add_argument("--poses", type=int, default=2000, help="for each part and disc")
    benches: dict[str, Callable[[argparse.Namespace], Any]] = {
        "compile": lambda _: first_call(),
        "speed": lambda _: speed(),
        "goldberg": lambda _: goldberg(),
        "convergence": lambda options: convergence(options.poses),
    }
    parser.add_argument("--only", nargs="+", choices=list(benches), default=list(benches))
    options = parser.parse_args()
    results = RESULTS.read({})
    for name in options.only:
        results[name] = benches[name](options)
    results["setting"] = {"step_mm": DEFAULT_STEP_MM, "poses": options.poses}
    results["setting"] |= {"python": platform.python_version(), "machine": platform.machine()}
    RESULTS.write(results)


if __name__ == "__main__":
    main()
