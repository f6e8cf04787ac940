"""The audit in a whole simulated cell, and its charts on cells that drift; not part of the gate.

    python tests/bench/bench_audit.py [--parts 200] [--blocks 40] [--runs 200] [--expected F]

Prints figures and writes `results/audit.json` beside this file.

loop: the camera is calibrated by `grasp-calibrate camera` and `tag` from the pictures of `grasp-cell
--camera-views`; then every part goes through table, `grasp-runtime --audit`, Modbus gripper, arm, rendered
camera and `grasp-audit judge`, each in its own process and protocol. Some leaves of the table are wrong. The
verdicts in the journal are compared with where the world says the parts are.
drift: parts run in the contact world through the table, watched by all charts of `grasp-audit report` with
the readings expected by `plan-expect`; from part 300 on something is wrong (`drift_trials.py`).
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]

import audit_loops  # noqa: E402
import drift_trials  # noqa: E402

from drivers.camera.calibration import file as calibration  # noqa: E402
from drivers.camera.vision import tag_file  # noqa: E402
from drivers.sim.camera.rig import standard_rig  # noqa: E402
from planner.cli import expect  # noqa: E402
from planner.job import model as job_file  # noqa: E402
from runtime.spc import expectation  # noqa: E402
from runtime.table import dump, load  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "audit.json"
TREE = ROOT / "trees" / "rectangle" / "rectangle.msgpack"
CALIBRATE = "import sys; from runtime.cli import calibrate; sys.exit(calibrate())"
WHAT = ("loop", "healthy", "drift")


def loop(parts: int, time_scale: float) -> dict[str, Any]:
    """Runs parts through the whole cell; a run that ends in a fault is followed by another."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fitted = calibrated(folder)
        dump(audit_loops.mixed(load(TREE).table), folder / "mixed.msgpack")
        tree = folder / "mixed.msgpack"
        result = audit_loops.loop(tree, folder, parts=parts, seed=100, time_scale=time_scale)
    # On a busy machine deadlines fail at many times life's speed; whose, the first word says.
    faults = Counter(reason.partition(" ")[0] for reason in result.faults)
    record = {"outcomes": dict(result.outcomes), "faults": dict(faults), "time_scale": time_scale}
    return audit_loops.agreement(result.parts) | record | {"calibration": fitted}


def calibrated(folder: Path) -> dict[str, float]:
    """Calibrates the cell's camera and its part's tag by our own commands; how far off they are."""
    cell = [
        sys.executable,
        "-m",
        "drivers.sim.cli",
        "--tree",
        str(TREE),
        "--camera-views",
        str(folder),
    ]
    printed = subprocess.run(cell, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    for line in printed.splitlines():
        subprocess.run(
            [sys.executable, "-c", CALIBRATE, *shlex.split(line)[1:]], cwd=ROOT, check=True
        )
    known, rig = calibration.load(folder / "camera.json"), standard_rig()
    tag = tag_file.load(folder / "tag.json").on_part
    return {
        "board_rms_px": known.rms_px,
        "alignment_mm": known.alignment_mm,
        "eye_off_mm": float(abs(known.view.eye - rig.optics.eye_mm).max()),
        "tag_off_mm": max(abs(a - b) for a, b in zip(tag[:2], rig.on_part[:2], strict=True)),
        "tag_off_rad": abs(tag[2] - rig.on_part[2]),
    }


def drift(options: argparse.Namespace) -> Iterator[tuple[str, Any]]:
    """False alarms of a healthy cell, and how soon each drift is flagged."""
    table = load(TREE).table
    job = job_file.from_canonical(str(table.job))
    with tempfile.TemporaryDirectory() as name:
        path = options.expected or Path(name) / "expected.json"
        if not path.exists() and expect.main([str(TREE), "-o", str(path)]):
            raise SystemExit("plan-expect failed")
        expected = expectation.load(path)
    if "healthy" in options.only:
        yield "healthy", drift_trials.healthy(table, job, expected, options.blocks)
    if "drift" in options.only:
        yield (
            "drift",
            drift_trials.drifting(table, job, expected, options.runs) | {"runs": options.runs},
        )


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", type=int, default=200)
    parser.add_argument("--time-scale", type=float, default=5.0)
    parser.add_argument("--blocks", type=int, default=40, help="of 10 000 healthy parts")
    parser.add_argument("--runs", type=int, default=200, help="histories of each drift")
    parser.add_argument("--expected", type=Path, help="from plan-expect, made if need be")
    parser.add_argument("--only", nargs="+", choices=WHAT, default=WHAT)
    options = parser.parse_args()
    record: dict[str, Any] = {}
    if "loop" in options.only:
        record["loop"] = loop(options.parts, options.time_scale)
        print(json.dumps(record["loop"], indent=1), flush=True)
    if {"healthy", "drift"} & set(options.only):
        record |= dict(drift(options))
    before = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    RESULTS.write_text(json.dumps(before | record, indent=1) + "\n")


if __name__ == "__main__":
    main()
