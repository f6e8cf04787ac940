"""Measures how exactly the camera locates tags on rendered pictures.

    python tests/bench/bench_camera.py [--pictures 500] [--limits 200]

Pictures have 1920 x 1080 pixels. Tags are 22 mm across; the camera sees them from 600 mm below the table.
The tags on `--pictures` ordinary pictures are measured twice: with the true calibration, and with one that
`grasp-calibrate camera` makes from rendered views of boards. For each of several flaws, such as blur, the
tags on `--limits` pictures are measured with the true calibration alone.

Uses one core. Prints figures and writes `results/camera.json` beside this file. Not part of `tools/check`.
"""

import contextlib
import platform
import shlex
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import harness
import numpy as np
from cameras import SIDE_MM, angle_between, part_tag, stain, true_calibration

from drivers.camera.calibration import command as calibrate_command
from drivers.camera.calibration import file as calibration
from drivers.camera.calibration import measure
from drivers.camera.vision.plane import View
from drivers.camera.vision.tags import find
from drivers.errors import PictureError
from drivers.planar import compose
from drivers.sim.camera import album
from drivers.sim.camera.cards import lying, tag_cells
from drivers.sim.camera.optics import Array
from drivers.sim.camera.render import Flaws, render
from drivers.sim.camera.rig import standard_rig

RESULTS = harness.Kept("camera")
OPTICS = standard_rig().optics
CENTRE_MM = 150.0
LIMITS: dict[str, dict[str, Any]] = {
    "as the 500": {},
    "blur 1.5 px, noise 4": {"blur_px": 1.5, "noise": 4.0},
    "noise 8": {"noise": 8.0},
    "noise 8, blur 1.3 px, JPEG 60": {"blur_px": 1.3, "noise": 8.0, "jpeg_quality": 60},
    "JPEG 40": {"jpeg_quality": 40},
    "a quarter of the light, noise 4": {"gain": 0.25, "noise": 4.0},
    "gradient 1.0": {"gradient": 1.0},
    "motion 3 px": {"motion_px": 3.0},
    "stain 2.5 mm on a side": {"stain_mm": 2.5},
    "beyond: blur 2.5 px": {"blur_px": 2.5},
    "beyond: motion 8 px": {"motion_px": 8.0},
}


def calibrated(folder: Path, seed: int) -> dict[str, Any]:
    """Calibrates the camera from rendered pictures by our own command; returns the calibration's figures."""
    camera, _ = album.write(standard_rig(), folder, seed)
    if calibrate_command.main(shlex.split(camera)):
        raise SystemExit("the calibration was refused")
    fitted = calibration.load(folder / "camera.json")
    return {
        "views": fitted.views,
        "rms_px": fitted.rms_px,
        "alignment_mm": fitted.alignment_mm,
        "focal_px": fitted.view.lens.focal,
        "eye_mm": fitted.view.eye.tolist(),
    }


def poses(rng: np.random.Generator, view: View, count: int) -> list[tuple[float, float, float]]:
    """Random poses of tags [mm, mm, rad] all over the picture; each tag is in view with its margin."""
    reach = 0.5 * SIDE_MM * 1.25 * np.sqrt(2.0)
    rim = np.array([(x, y) for x in (-reach, reach) for y in (-reach, reach)])
    results = []
    while len(results) < count:
        pose = tuple(map(float, rng.uniform((-500.0, -280.0, -np.pi), (500.0, 280.0, np.pi))))
        pixels = view.pixels_at(rim + pose[:2])
        if pixels.min() > 2 and (pixels < (OPTICS.width - 3, OPTICS.height - 3)).all():
            results.append(pose)
    return results


def shot(
    rng: np.random.Generator, pose: tuple[float, float, float], number: int, flaws: dict[str, Any]
) -> Any:
    """Renders the tag `number` at a pose; `flaws` replace the ordinary flaws of the picture."""
    values = {"blur_px": rng.uniform(0.6, 1.0), "gain": rng.uniform(0.7, 1.0), **flaws}
    heading, motion_px = rng.uniform(0.0, 2 * np.pi), values.pop("motion_px", 0.0)
    speed = motion_px * 600.0 / OPTICS.focal
    card = lying(tag_cells(number), SIDE_MM / 8, pose, face_down=True)
    card = replace(card, speed_mm=speed * np.array([np.cos(heading), np.sin(heading), 0.0]))
    cards, size = [card], values.pop("stain_mm", 0.0)
    if size:
        middle = (rng.uniform(-0.35, 0.35) * SIDE_MM, 0.5 * SIDE_MM + 0.25 * size, 0.0)
        cards.append(stain(compose(pose, middle), (size, size)))
    return render(OPTICS, cards, Flaws(**values), rng)


def measured(
    count: int, seed: int, flaws: dict[str, Any], built: calibration.CameraCalibration | None
) -> dict[str, Any]:
    """Renders `count` pictures and measures their tags; returns errors, misses, wrong numbers and times.

    Args:
        count: number of pictures.
        seed: seed of poses, tags and flaws.
        flaws: flaws of all pictures.
        built: a calibration to measure with besides the true one; None: the true one alone.
    """
    rng = np.random.default_rng(seed)
    truth, tag = true_calibration(OPTICS, references=False), part_tag(on_part=(0.0, 0.0, 0.0))
    off, ours, wrong, missed, spent = [], [], 0, 0, []
    for pose in poses(rng, truth.view, count):
        number = int(rng.integers(587))
        picture = shot(rng, pose, number, flaws)
        start = time.process_time()
        seen = find(picture)
        numbers = [result.number for result in seen]
        place = None
        with contextlib.suppress(PictureError):
            place = measure.of_sighting(seen[0], truth, tag) if numbers == [number] else None
        spent.append(1e3 * (time.process_time() - start))
        wrong += sum(result != number for result in numbers)
        if place is None:
            missed += 1
            continue
        off.append(errors(place.pose, pose))
        if built is not None:
            with_ours = measure.of_sighting(seen[numbers.index(number)], built, tag)
            radius_mm = float(np.hypot(*pose[:2]))
            ours.append((*errors(with_ours.pose, pose), radius_mm, with_ours.sigma_mm))
    row = {"pictures": count, "missed": missed, "wrong_ids": wrong}
    row |= {
        "detection": 1.0 - missed / count,
        "ms_mean": float(np.mean(spent)),
        "ms_p95": float(np.percentile(spent, 95)),
    }
    if off:
        row |= summary(np.array(off).T, "true_calibration")
    if ours:
        place_mm, _, radius_mm, sigma_mm = values = np.array(ours).T
        row |= summary(values[:2], "own_calibration")
        row["own_calibration_centre_mm_mean"] = float(place_mm[radius_mm < CENTRE_MM].mean())
        row["own_calibration_within_3_sigma"] = float(np.mean(place_mm < 3.0 * sigma_mm))
    return row


def errors(pose: tuple[float, ...], truth: tuple[float, ...]) -> tuple[float, float]:
    """Distance [mm] and angle [deg] of a measured pose from the true one."""
    off = float(np.hypot(pose[0] - truth[0], pose[1] - truth[1]))
    return off, abs(float(np.degrees(angle_between(pose[2], truth[2]))))


def summary(values: Array, name: str) -> dict[str, float]:
    """Mean, 95th percentile and maximum of distances [mm] and angles [deg] (2, n); `name` begins each key."""
    figures = {"mean": np.mean, "p95": lambda v: np.percentile(v, 95), "max": np.max}
    return {
        f"{name}_{unit}_{figure}": float(call(row))
        for unit, row in zip(("mm", "deg"), values, strict=True)
        for figure, call in figures.items()
    }


def main() -> None:
    """Runs the benchmark."""
    parser = harness.parser(__doc__)
    parser.add_argument("--pictures", type=int, default=500)
    parser.add_argument("--limits", type=int, default=200)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        record: dict[str, Any] = {
            "machine": {"system": platform.system(), "processor": platform.machine()},
            "opencv": cv2.__version__,
            "calibration": calibrated(Path(folder), 1),
        }
        fitted = calibration.load(Path(folder) / "camera.json")
    record["work_area"] = measured(options.pictures, 2, {}, fitted)
    harness.show(record)
    record["limits"] = {}
    for seed, (name, flaws) in enumerate(LIMITS.items()):
        row = record["limits"][name] = measured(options.limits, 10 + seed, flaws, None)
        harness.show({"limits": name, **row})
    RESULTS.write(record)


if __name__ == "__main__":
    main()
