"""Measures the audit in a whole simulated cell, and how fast its control charts flag cells that drift.

    python tests/bench/bench_audit.py [--parts 200] [--blocks 40] [--runs 200] [--expected F]

Prints figures and writes `results/audit.json` beside this file. Not part of `tools/check`.

loop: `grasp-calibrate camera` and `tag` calibrate the camera from the pictures of `grasp-cell
--camera-views`. Then parts run through `grasp-runtime --audit` in a simulated cell that speaks the real
protocols. Its camera is rendered, and some leaves of its table are wrong. The verdicts in the journal are
compared with the true poses of the parts.

healthy: parts of a healthy cell run through the table in the contact world. All alarms of the charts of
`grasp-audit report` are false and are counted.

drift: after 300 healthy parts something in the cell changes (`drift_trials.py`). The parts until the first
alarm are counted. Here and for `healthy`, the charts use the readings that `plan-expect` expects.
"""

import argparse
import json
import shlex
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import harness
from audit_loops import agreement, mixed
from audit_loops import loop as run_loop
from drift_trials import drifting, healthy
from programs import CELL, TABLE, called, ended

from drivers.camera.calibration import file as calibration
from drivers.camera.vision import tag_file
from drivers.sim.camera.rig import standard_rig
from planner.cli import expect
from planner.job import model as job_file
from runtime.cli import calibrate
from runtime.spc import expectation
from runtime.table import dump, load

RESULTS = harness.Kept("audit")
WHAT = ("loop", "healthy", "drift")


def loop(parts: int, time_scale: float) -> dict[str, Any]:
    """Runs parts through the whole cell; returns figures of the audits and of the calibration.

    A fault ends a run, and another run continues.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fitted = calibrated(folder)
        dump(mixed(load(TABLE).table), folder / "mixed.msgpack")
        tree = folder / "mixed.msgpack"
        result = run_loop(tree, folder, parts=parts, seed=100, time_scale=time_scale)
    # At many times real speed a busy machine misses deadlines; a reason's first word names the device.
    faults = Counter(reason.partition(" ")[0] for reason in result.faults)
    record = {"outcomes": dict(result.outcomes), "faults": dict(faults), "time_scale": time_scale}
    return agreement(result.parts) | record | {"calibration": fitted}


def calibrated(folder: Path) -> dict[str, float]:
    """Calibrates the cell's camera and the part's tag by our own commands; returns their errors."""
    cell = ended([*CELL, "--tree", TABLE, "--camera-views", folder], timeout=None)
    for line in cell.out.splitlines():
        if called(calibrate, *shlex.split(line)[1:]).code:
            raise SystemExit(f"{line} failed")
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
    """Yields name and figures of each chosen study: `healthy` for false alarms, `drift` for delays."""
    table = load(TABLE).table
    job = job_file.from_canonical(str(table.job))
    with tempfile.TemporaryDirectory() as name:
        path = options.expected or Path(name) / "expected.json"
        if not path.exists() and expect.main([str(TABLE), "-o", str(path)]):
            raise SystemExit("plan-expect failed")
        expected = expectation.load(path)
    if "healthy" in options.only:
        yield "healthy", healthy(table, job, expected, options.blocks)
    if "drift" in options.only:
        figures = drifting(table, job, expected, options.runs)
        yield "drift", figures | {"runs": options.runs}


def main() -> None:
    """Runs the chosen studies and adds their figures to the file of results."""
    parser = harness.parser(__doc__)
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
    RESULTS.write(RESULTS.read({}) | record)


if __name__ == "__main__":
    main()
