"""Measures how well we predict pushes that a real robot made with two fingers.

    python tests/bench/bench_pushes.py --data FOLDER

FOLDER holds two push logs, `hardboard_3pts3.txt` and `plywood_3pts1.txt` (as `plan-identify` reads them), and
`two_fingers.csv`. This table has one push a line, in the columns that `plan-simulate --push` reads, and in
the columns `support` (3pts1, 3pts3 or patch), `run` and `index`. Its columns `moved_x_mm`, `moved_y_mm` and
`turned_deg` are what was measured. If there is a file `two_fingers_more.csv` of further runs, it is judged,
too.

A single finger pushes in the logs. Friction and the scatter of the limit surface are fitted to them: friction
by the least mean error of the final pose, the Wishart distribution's degrees of freedom by the coverage of
90 % intervals. The pushes with two fingers are only judged.

Prints figures and writes `results/pushes.json`. Not part of `tools/check`.
"""

import csv
import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

import harness
import numpy as np
from programs import ROOT

from planner.arrays import Array, BoolArray, take
from planner.cli import pushes
from planner.identification import pushes as push_log
from planner.job import model as job_file
from planner.mechanics.push import STUCK, Paths
from planner.mechanics.simulator import STUCK_DEG, STUCK_MM, Simulator, commanded
from planner.part.outline import radius_of_gyration

RESULTS = harness.Kept("pushes")
DATA = ROOT.parent / "shared" / "data" / "pushes"
LOGS = {"hardboard_3pts3.txt": "3pts3", "plywood_3pts1.txt": "3pts1"}
TWO_FINGERS = "two_fingers.csv"
MORE = "two_fingers_more.csv"  # further runs of the same recordings, judged beside them if present
SOURCE = (
    "the pushes are public logs of Carnegie Mellon University's Manipulation Lab (2015, the robot data of "
    "arXiv 1602.06056), in the columns that the head of this file states; give their folder with --data"
)
FINGERS_MM = 50.0
SUPPORTS = {
    "3pts1": 'kind = "points"\npoints_mm = [[30, 30], [63.33, 43.33], [43.33, 63.33]]',
    "3pts3": 'kind = "points"\npoints_mm = [[30, 30], [90, 30], [30, 90]]',
    "patch": 'kind = "uniform"',
}
JOB = """
part = {{ name = "right triangle", outline_mm = [[0, 0], [150, 0], [0, 150]] }}
friction = {{ finger_part_min = {low}, finger_part_max = {high} }}
gripper = {{ finger_length_mm = 20, finger_width_mm = 10, opening_mm = 200 }}
uncertainty = {{ radius_mm = 10, orientation = "unknown" }}
actions = {{ angles_deg = [0], centers_mm = [[0, 0]] }}
goal = {{ distance_mm = 3, confidence = 0.9 }}
[pressure]
wishart_dof = {dof}
{support}
"""
FRICTIONS = np.arange(0.05, 1.01, 0.05)
# The interval of friction: whose mean error on the logs is within 5 % of the least.
NEARLY_AS_GOOD = 1.05
DOFS = (5, 7, 10, 15, 20, 30, 50, 100, 200)
SAMPLES = 400
NOISE = np.array([0.7, 0.7, math.radians(0.6)])
"""How well pushes that stick agree with the command, as the data's description states [mm, mm, rad]."""
OFF_MM, OFF_DEG = 20.0, 15.0  # A worse final pose than this is named


class Recorded(NamedTuple):
    """Recorded pushes, and the measured displacements of the block, in its frame at the start."""

    paths: Paths
    moved: Array  # (n, 3) [mm, mm, rad]


def simulator(support: str, friction: tuple[float, float], dof: int) -> Simulator:
    """A simulator of the block on a support, with bounds of friction and degrees of freedom."""
    text = JOB.format(low=friction[0], high=friction[1], dof=dof, support=SUPPORTS[support])
    return Simulator.of_job(job_file.parse(text, f"the job of {support}"))


def read_log(path: Path) -> Recorded:
    """Reads a log of straight pushes by a single finger."""
    log = push_log.parse(path.read_text(encoding="utf-8"), str(path))
    sideways = push_log.tip_offset(log)
    starts, shifts, moved = [], [], []
    for push in log:
        (before, x, y), (after, *end) = (_pose(pose) for pose in (push.before, push.after))
        tips = push.pusher[[0, -1], 1:3] + sideways * _turn(_yaw(push.pusher[-1, 4:]))[:, 1]
        start, stop = (tips - [x, y]) @ _turn(before)
        starts.append([start])
        shifts.append(stop - start)
        turned = math.remainder(after - before, math.tau)
        moved.append([*((np.array(end) - [x, y]) @ _turn(before)), turned])
    n = len(log)
    paths = Paths(np.array(starts), np.zeros((n, 2)), np.zeros(n), np.array(shifts))
    return Recorded(paths, np.array(moved))


def _yaw(quaternion: Array) -> float:
    w, x, y, z = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _turn(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _pose(marker: Array) -> tuple[float, float, float]:
    """Angle [rad] and place [mm] of the block's centroid, from a logged pose of the block's marker."""
    angle = _yaw(marker[3:])
    x, y = marker[:2] + _turn(angle) @ push_log.MARKER_TO_PART_MM
    return angle, float(x), float(y)


def fit_friction(logs: dict[str, Recorded]) -> tuple[float, tuple[float, float], dict[str, float]]:
    """Fits the friction between finger and block to the logs.

    Returns:
        The best value, the interval of values nearly as good, and the best value of each log alone.
    """
    errors = np.empty((len(logs), len(FRICTIONS)))
    for row, (support, log) in enumerate(logs.items()):
        block = simulator(support, (0.4, 0.6), 100)
        for column, mu in enumerate(FRICTIONS):
            pushed = block.push(log.paths, block.nominal(len(log.moved), mu))
            errors[row, column] = pose_error(pushed.moved - log.moved, block).mean()
    mean = errors.mean(axis=0)
    near = FRICTIONS[mean <= NEARLY_AS_GOOD * mean.min()]
    alone = dict(zip(logs, FRICTIONS[errors.argmin(axis=1)].round(2).tolist(), strict=True))
    interval = round(float(near[0]), 2), round(float(near[-1]), 2)
    return round(float(FRICTIONS[mean.argmin()]), 2), interval, alone


def pose_error(off: Array, block: Simulator) -> Array:
    """Sizes (n,) of errors of poses (n, 3) [mm]: distance, plus the radius of gyration times the angle."""
    rho_mm = radius_of_gyration(block.outline)
    return np.asarray(np.hypot(off[:, 0], off[:, 1]) + rho_mm * np.abs(off[:, 2]))


def draws(recorded: Recorded, block: Simulator, seed: int) -> tuple[BoolArray, Array]:
    """Simulates the recorded pushes many times with random mechanics.

    Returns:
        A mask (n, 3): whether the measured x, y and angle lie in the central 90 % of the noisy results; and
        the share (n,) of the results in which the block sticks to the fingers.
    """
    n, rng = len(recorded.moved), np.random.default_rng(seed)
    many = take(recorded, np.repeat(np.arange(n), SAMPLES))
    pushed = block.push(many.paths, block.sample(n * SAMPLES, rng))
    moved = pushed.moved.reshape(n, SAMPLES, 3)
    low, high = np.quantile(moved + NOISE * rng.standard_normal(moved.shape), (0.05, 0.95), axis=1)
    covered = (low <= recorded.moved) & (recorded.moved <= high)
    return covered, (pushed.status == STUCK).reshape(n, SAMPLES).mean(axis=1)


def fit_dof(logs: dict[str, Recorded], friction: tuple[float, float]) -> tuple[int, float]:
    """Fits the degrees of freedom so that 90 % intervals hold nearly 90 % of the logs' poses.

    Returns the degrees of freedom and the share of poses that the intervals hold.
    """
    shares = {}
    for dof in DOFS:
        blocks = {support: simulator(support, friction, dof) for support in logs}
        covered = [draws(log, blocks[support], 0)[0].mean() for support, log in logs.items()]
        shares[dof] = float(np.mean(covered))
    best = min(DOFS, key=lambda dof: abs(shares[dof] - 0.9))
    return best, shares[best]


def read_two_fingers(path: Path) -> tuple[Recorded, list[dict[str, str]]]:
    """Reads pushes with two fingers; returns them, and the lines of the file as text by column."""
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    paths = pushes.paths(pushes.read(path, FINGERS_MM), push_log.MARKER_TO_PART_MM)
    columns = ("moved_x_mm", "moved_y_mm", "turned_deg")
    moved = [[float(line[name]) for name in columns] for line in lines]
    return Recorded(paths, np.array(moved) * [1.0, 1.0, math.pi / 180.0]), lines


def is_stuck(recorded: Recorded) -> BoolArray:
    """Mask (n,) of the pushes in which the block stuck to the fingers, that is, moved as they did."""
    off = recorded.moved - commanded(recorded.paths)
    near = np.hypot(off[:, 0], off[:, 1]) < STUCK_MM
    return np.asarray(near & (np.abs(off[:, 2]) < math.radians(STUCK_DEG)))


def judged(
    recorded: Recorded, block: Simulator, mu: float, seed: int
) -> tuple[dict[str, float], Array, BoolArray]:
    """Compares pushes on one support with their prediction.

    Returns:
        Figures; errors of the predicted displacements (n, 3); and a mask (n,): whether it was predicted
        rightly that the block sticks or slides.
    """
    pushed = block.push(recorded.paths, block.nominal(len(recorded.moved), mu))
    stuck, off = is_stuck(recorded), pushed.moved - recorded.moved
    distance, right = np.hypot(off[:, 0], off[:, 1]), (pushed.status == STUCK) == stuck
    covered, share = draws(recorded, block, seed)
    undecided = (share > 0.05) & (share < 0.95)
    figures = {
        "pushes": len(stuck),
        "predicted": float(right.mean()),
        "majority": float(max(stuck.mean(), 1.0 - stuck.mean())),
        "foretold_stuck_but_slid": int((~right & ~stuck).sum()),
        "foretold_slid_but_stuck": int((~right & stuck).sum()),
        "undecided": int(undecided.sum()),
        "wrong_and_undecided": int((~right & undecided).sum()),
        "median_mm_slid": float(np.median(distance[~stuck])),
        "median_deg_slid": float(np.degrees(np.median(np.abs(off[~stuck, 2])))),
        "p90_mm_slid": float(np.quantile(distance[~stuck], 0.9)),
        "median_mm_stuck": float(np.median(distance[stuck])),
        "median_deg_stuck": float(np.degrees(np.median(np.abs(off[stuck, 2])))),
        "coverage_slid": float(covered[~stuck].mean()),
        "coverage_stuck": float(covered[stuck].mean()),
        "coverage": float(covered.mean()),
    }
    return figures, off, right


def judged_more(
    path: Path, interval: tuple[float, float], dof: int, mu: float
) -> dict[str, dict[str, float]]:
    """Figures of the pushes in the file of further runs, by support."""
    recorded, lines = read_two_fingers(path)
    supports = np.array([line["support"] for line in lines])
    result = {}
    for seed, support in enumerate(SUPPORTS, 1):
        mine, block = take(recorded, supports == support), simulator(support, interval, dof)
        result[support], _, _ = judged(mine, block, mu, seed)
    return result


def too_far(recorded: Recorded) -> BoolArray:
    """Mask (n,) of pushes after which the block lies farther from its start than any finger went.

    Pushing cannot move a block that far, so the record is wrong.
    """
    paths = recorded.paths
    arms = np.linalg.norm(paths.points - paths.centres[:, None], axis=2).max(axis=1)
    gone_mm = np.hypot(recorded.moved[:, 0], recorded.moved[:, 1])
    return np.asarray(gone_mm > 1.2 * arms * np.abs(paths.angles))


def runs_of(
    lines: list[dict[str, str]], recorded: Recorded, off: Array, right: BoolArray
) -> list[dict[str, Any]]:
    """A row for each recorded run: share predicted rightly, median error, pushes that end far off."""
    distance, turned = np.hypot(off[:, 0], off[:, 1]), np.degrees(off[:, 2])
    names, beyond = np.array([line["run"] for line in lines]), too_far(recorded)
    rows = []
    for run in dict.fromkeys(names):
        mine = names == run
        far = np.flatnonzero(mine & ((distance > OFF_MM) | (np.abs(turned) > OFF_DEG)))
        named = [
            f"{lines[k]['index']}: {distance[k]:.0f} mm, {turned[k]:+.0f} deg"
            + (", recorded as farther than the fingers went" if beyond[k] else "")
            for k in far
        ]
        row = {"run": str(run), "pushes": int(mine.sum()), "predicted": float(right[mine].mean())}
        rows.append({**row, "median_mm": float(np.median(distance[mine])), "far_off": named})
    return rows


def main() -> int:
    """Fits to the logs, judges the pushes with two fingers, and writes the figures; returns the exit code."""
    parser = harness.parser(__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the pushes")
    options = parser.parse_args()
    if missing := [name for name in (*LOGS, TWO_FINGERS) if not (options.data / name).is_file()]:
        said = f"{options.data} has no {', '.join(missing)}"
        print(f"bench_pushes: {said}: {SOURCE}", file=sys.stderr)
        return 3
    logs = {support: read_log(options.data / name) for name, support in LOGS.items()}
    mu, interval, alone = fit_friction(logs)
    dof, share = fit_dof(logs, interval)
    print(
        f"from the logs: friction {mu} in {interval} (alone: {alone}), {dof} degrees of freedom ({share:.3f})"
    )
    recorded, lines = read_two_fingers(options.data / TWO_FINGERS)
    result: dict[str, Any] = {"friction": mu, "interval": interval, "alone": alone, "dof": dof}
    result["supports"] = {}
    off, right = np.zeros((len(lines), 3)), np.zeros(len(lines), bool)
    supports = np.array([line["support"] for line in lines])
    for seed, support in enumerate(SUPPORTS, 1):
        mine = supports == support
        block = simulator(support, interval, dof)
        figures, off[mine], right[mine] = judged(take(recorded, mine), block, mu, seed)
        result["supports"][support] = figures
        harness.show({"support": support, **figures})
    if (options.data / MORE).is_file():
        result["more"] = judged_more(options.data / MORE, interval, dof, mu)
        for support, figures in result["more"].items():
            harness.show({"more": support, **figures})
    slid, distance = ~is_stuck(recorded), np.hypot(off[:, 0], off[:, 1])
    result["median_mm_slid"] = float(np.median(distance[slid]))
    result["runs"] = runs_of(lines, recorded, off, right)
    print(f"median error of pushes that did not stick: {result['median_mm_slid']:.2f} mm")
    for row in result["runs"]:
        harness.show(row)
    RESULTS.write(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
