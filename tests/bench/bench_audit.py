"""The audit in a whole simulated cell, and its charts on cells that drift; not part of the gate.

    python tests/bench/bench_audit.py [--parts 200] [--healthy 10000] [--only loop drift]

Prints figures and writes `results/audit.json` beside this file.

loop: every part goes through table, runtime, Modbus gripper, arm, rendered camera and `grasp-audit judge`,
each in its own process and protocol; the verdict is compared with where the world says the part is.
drift: parts run in the contact world through the table; from one part on something is wrong.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from cameras import part_tag, true_calibration  # noqa: E402

from drivers import connect  # noqa: E402
from drivers.camera import calibration, tag_file  # noqa: E402
from drivers.camera.calibration import Reference  # noqa: E402
from drivers.sim.camera.rig import standard_rig  # noqa: E402
from drivers.sim.camera.server import CameraServer  # noqa: E402
from planner import job as job_file  # noqa: E402
from planner.arrays import Array  # noqa: E402
from planner.belief import initial  # noqa: E402
from planner.encoder import encoder_of  # noqa: E402
from planner.evaluate import _squeeze_all, metric_of_table, placement_of  # noqa: E402
from planner.frames import to_hand, to_world, wrap  # noqa: E402
from planner.job import Job  # noqa: E402
from planner.world import make  # noqa: E402
from runtime import session  # noqa: E402
from runtime.cell_process import CellProcess  # noqa: E402
from runtime.cli import SystemClock  # noqa: E402
from runtime.executor import Cell  # noqa: E402
from runtime.geometry import predicted_pose  # noqa: E402
from runtime.quality.history import History, Part, Squeezed  # noqa: E402
from runtime.quality.monitor import watch  # noqa: E402
from runtime.results import Outcome  # noqa: E402
from runtime.table import REJECT, Calibration, Table, count_map, load  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "audit.json"
TREE = ROOT / "trees" / "rectangle" / "rectangle.msgpack"
TIME_SCALE = 12.0
ON_PART = (2.0, -1.0, 0.3)
DRIFT_FROM, DRIFTED = 300, 100


class Audit:
    """`grasp-audit judge` as a child, asked as the runtime asks it."""

    def __init__(self, words: list[str]) -> None:
        command = [sys.executable, "-m", "drivers.camera.cli", "judge", *words]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT)
        self.seconds: list[float] = []

    def judge(self, part: int, pose: tuple[float, float, float]) -> dict[str, Any]:
        """The answer for one part."""
        asked = dict(zip(("part", "x_mm", "y_mm", "theta_rad"), (part, *pose), strict=True))
        start = time.perf_counter()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(asked).encode() + b"\n")
        self._process.stdin.flush()
        told: dict[str, Any] = json.loads(self._process.stdout.readline())
        self.seconds.append(time.perf_counter() - start)
        return told

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10.0)


class Judging:
    """Stands where a console does: has each part judged while it still lies there."""

    def __init__(self, table: Table, audit: Audit) -> None:
        self._table, self._audit = table, audit
        self.judged: list[tuple[dict[str, Any], float]] = []
        self.ended: Counter[str] = Counter()

    def note(self, sentence: str) -> None:
        """Say nothing."""

    def step(self, part: int, step: Any) -> None:
        """Look away."""

    def part(self, result: Any, seen: Any) -> None:
        """Judge a part that ended at a leaf; keep the true distance beside the answer."""
        self.ended[result.outcome.value] += 1
        if result.outcome is Outcome.LEAF:
            answer = self._audit.judge(result.part, predicted_pose(self._table.leaves[result.leaf]))
            self.judged.append((answer, seen.error_mm))


class Nowhere:
    """A journal that keeps nothing: this benchmark is of the audit."""

    def record(self, kind: str, fields: Any) -> None:
        """Forget it."""


def loop(parts: int, wrong_mm: float) -> dict[str, Any]:
    """Runs parts through the whole cell.

    Args:
        parts: how many.
        wrong_mm: the leaf's pose is told to the audit this far off, to see failures too.
    """
    table, rig = load(TREE), replace(standard_rig(), on_part=ON_PART)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        places = tuple(Reference(number, x, y) for number, (x, y, _) in rig.references)
        known = replace(true_calibration(rig.optics, 0.05), references=places)
        calibration.save(known, folder / "camera.json")
        tag_file.save(part_tag(on_part=ON_PART), folder / "tag.json", "2026-01-01")
        process = CellProcess(TREE, world="planner.world:make", seed=1, time_scale=TIME_SCALE)
        with process as started:
            cell = started.endpoints
            eye = connect.scene(cell.scene)

            def now() -> tuple[float, float, float]:
                truth = eye.truth()
                return (truth.x_mm, truth.y_mm, truth.theta_rad)

            with CameraServer(rig.taker(now, seed=1)) as camera:
                words = ["--tree", str(TREE), "--camera", camera.url, "--deadline", "60"]
                words += ["--calibration", str(folder / "camera.json"), "--tag", str(folder / "tag.json")]
                audit = Audit(words)
                shifted = _shifted(table, wrong_mm)
                console = Judging(shifted, audit)
                gripper = connect.gripper(cell.gripper, time_scale=TIME_SCALE)
                arm = connect.arm(cell.arm, time_scale=TIME_SCALE)
                scene = connect.scene(cell.scene)
                inside = Cell(gripper, arm, SystemClock(TIME_SCALE), Nowhere())
                # At many times life's speed a busy machine makes deadlines fail; that is not the audit's.
                while (left := parts - console.ended.total()) > 0:
                    session.run_journalled(shifted, inside, scene, console, count=left, activate=True)
                for device in (gripper, arm, scene, eye, audit):
                    device.close()
    return _agreement(console.judged, table.goal.distance_um / 1e3) | {
        "parts": parts,
        "outcomes": dict(console.ended),
        "shift_mm": wrong_mm,
        "answer_s_mean": float(np.mean(audit.seconds[1:])),
    }


def _shifted(table: Table, wrong_mm: float) -> Table:
    """The same table, its leaves' poses off by so much in x."""
    off = round(1000 * wrong_mm)
    return replace(table, leaves=tuple(leaf._replace(x_um=leaf.x_um + off) for leaf in table.leaves))


def _agreement(judged: list[tuple[dict[str, Any], float]], goal_mm: float) -> dict[str, Any]:
    given = [(answer, error) for answer, error in judged if answer["verdict"] != "unknown"]
    agree = sum((answer["verdict"] == "pass") == (error < goal_mm) for answer, error in given)
    false = [error for answer, error in given if answer["verdict"] == "pass" and error >= goal_mm]
    off = [abs(answer["distance"] - error) / answer["error"] for answer, error in given]
    reasons = Counter(
        answer["reason"].partition(":")[0] for answer, _ in judged if answer["verdict"] == "unknown"
    )
    return {
        "at_leaves": len(judged),
        "verdicts": dict(Counter(answer["verdict"] for answer, _ in judged)),
        "unknown_because": dict(reasons),
        "agreement": agree / len(given) if given else None,
        "false_passes": len(false),
        "largest_error_in_units_of_the_budget": max(off, default=None),
    }


def drift(healthy: int) -> dict[str, Any]:
    """False alarms of a healthy cell, and after how many parts each fault is flagged."""
    table = load(TREE)
    job = job_file.from_canonical(str(table.job))
    told: dict[str, Any] = {"healthy_parts": healthy, "false_alarms": {}}
    for seed in (1, 2):
        alarms = list(watch(History(table, tuple(run(table, job, healthy, seed)))))
        told["false_alarms"][str(seed)] = [alarm.chart for alarm in alarms]
        print(f"healthy, seed {seed}: {len(alarms)} alarms in {healthy} parts", flush=True)
    before = run(table, job, DRIFT_FROM, 5)
    for name, fault in faults(job).items():
        rows = []
        for seed in (11, 12, 13):
            after = run(table, job, DRIFTED, seed, **fault)
            rows.append(_first(History(table, tuple(before + after))))
        told[name] = rows
        print(f"{name:28}", rows, flush=True)
    return told


def faults(job: Job) -> dict[str, dict[str, Any]]:
    """What goes wrong, by name."""
    friction = job.friction
    slippery = replace(job, friction=replace(friction, finger_part_min=0.05, finger_part_max=0.15))
    rough = replace(job, friction=replace(friction, finger_part_min=0.8, finger_part_max=1.0))
    return {
        "encoder +1 mm": {"width_mm": 1.0},
        "encoder -1 mm": {"width_mm": -1.0},
        "friction 0.05 to 0.15": {"world_job": slippery},
        "friction 0.8 to 1.0": {"world_job": rough},
        "camera 0.45 mm in x": {"seen_off": (0.45, 0.0, 0.0)},
        "camera 1 mm in y": {"seen_off": (0.0, 1.0, 0.0)},
        "camera turned by 2 deg": {"seen_off": (0.0, 0.0, 0.035)},
    }


def _first(history: History) -> dict[str, int]:
    """The first alarm of each chart, parts after the fault came; negative: before it."""
    found: dict[str, int] = {}
    for alarm in watch(history):
        found.setdefault(alarm.chart, alarm.place - DRIFT_FROM + 1)
    return found


def run(
    table: Table,
    job: Job,
    count: int,
    seed: int,
    *,
    width_mm: float = 0.0,
    seen_off: tuple[float, float, float] = (0.0, 0.0, 0.0),
    world_job: Job | None = None,
) -> list[Part]:
    """Parts in the contact world, through the table, as their journals would tell them.

    Args:
        table: the table.
        job: it was compiled from.
        count: how many parts.
        seed: of everything.
        width_mm: added to each width before it is read.
        seen_off: added to each measured pose.
        world_job: what the world is like, None: as planned.
    """
    rng = np.random.default_rng([seed, 7])
    poses, encoder, world = initial(job, count, rng), encoder_of(job), make(world_job or job, seed)
    linear = Calibration.linear(table.gripper)
    node, ends = np.zeros(count, np.int64), np.full(count, REJECT)
    squeezes: list[list[Squeezed]] = [[] for _ in range(count)]
    while np.any(node >= 0):
        for index in sorted(set(node[node >= 0].tolist())):
            members = np.flatnonzero(node == index)
            branches, placement = table.nodes[index].branches, placement_of(table.nodes[index].squeeze)
            final, width = _squeeze_all(world, to_hand(poses[members], placement))
            poses[members] = to_world(final, placement)
            taken = count_map(table.nodes[index], linear)
            for part, reading in zip(members, encoder.read(width + width_mm, rng), strict=True):
                branch = taken[int(reading)]
                squeezes[part].append(
                    Squeezed(index, None if branch == REJECT else branch, linear.width_um(int(reading)))
                )
                target = None if branch == REJECT else branches[branch].target
                node[part] = -1 if target is None or target < 0 else target
                ends[part] = -1 if target is None or target >= 0 else ~target
    noise = rng.normal(0.0, (0.05, 0.05, 0.002), poses.shape)
    return [_part(table, k, squeezes[k], int(ends[k]), poses[k] + noise[k] + seen_off) for k in range(count)]


def _part(table: Table, number: int, squeezes: list[Squeezed], end: int, seen: Array) -> Part:
    if end < 0:
        return Part(number, tuple(squeezes), "reject")
    leaf, metric = table.leaves[end], metric_of_table(table)
    predicted = np.array(predicted_pose(leaf))
    off = seen - predicted
    turn = float(wrap(np.array([off[2]]), table.goal.symmetry)[0])
    verdict = "pass" if bool(metric.reached(seen, predicted)) else "fail"
    outcome = "leaf" if leaf.resolved else "unresolved"
    return Part(number, tuple(squeezes), outcome, end, verdict, (float(off[0]), float(off[1]), turn))


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", type=int, default=200)
    parser.add_argument("--healthy", type=int, default=10_000)
    parser.add_argument("--only", nargs="+", choices=("loop", "drift"), default=("loop", "drift"))
    options = parser.parse_args()
    told: dict[str, Any] = {}
    if "loop" in options.only:
        told["loop"] = [loop(options.parts, 0.0), loop(options.parts // 2, 3.0)]
        print(json.dumps(told["loop"], indent=1), flush=True)
    if "drift" in options.only:
        told["drift"] = drift(options.healthy)
    before = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    RESULTS.write_text(json.dumps(before | told, indent=1) + "\n")


if __name__ == "__main__":
    main()
