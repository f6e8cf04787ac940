"""Calibration of one camera: lens, pose, uncertainty, and reference tags that reveal a moved camera."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drivers.camera import documents
from drivers.camera.vision.arrays import Array
from drivers.camera.vision.lens import Lens
from drivers.camera.vision.plane import View
from drivers.errors import PictureError

KIND = "camera calibration"
REMEDY = "make it again with grasp-calibrate camera"


class Reference(NamedTuple):
    """A fixed tag in view, at the table's height, with its place at the calibration, mm."""

    number: int
    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """Standard deviations of measured places due to errors of the calibration, on a grid over the table."""

    x_mm: Array  # (m,) ascending
    y_mm: Array  # (n,) ascending
    sigma_mm: Array  # (n, m) standard deviation in the worst direction

    def at(self, x_mm: float, y_mm: float) -> float:
        """Standard deviation at a place, mm, bilinearly interpolated; outside the grid it grows."""
        along_rows = [np.interp(x_mm, self.x_mm, row) for row in self.sigma_mm]
        inside = np.interp(y_mm, self.y_mm, along_rows)
        low, high = np.array([[axis[0], axis[-1]] for axis in (self.x_mm, self.y_mm)]).T
        place = np.array([x_mm, y_mm])
        beyond = np.hypot(*(place - np.clip(place, low, high)))
        return float(inside * (1.0 + 10.0 * beyond / np.hypot(*(high - low))))


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """Calibration of one camera at one place."""

    camera: str  # name or serial number of the camera, as the operator gave it
    date: str  # date of the calibration, ISO 8601
    view: View  # lens and pose in the arm's world frame
    rms_px: float  # rms reprojection error over the board views
    alignment_mm: float  # rms distance of touched and seen places; 0 without touched poses
    trust: Trust  # uncertainty of places
    references: tuple[Reference, ...] = ()  # fixed tags
    views: int = 0  # number of board views that the calibration was fitted to

    def check_size(self, shape: tuple[int, ...]) -> None:
        """Checks a picture's rows and columns; raises PictureError if they differ from this camera's."""
        lens = self.view.lens
        if tuple(shape[:2]) != (lens.height, lens.width):
            raise PictureError(
                f"the picture is {shape[1]} x {shape[0]}, the calibration of {self.camera} is for "
                f"{lens.width} x {lens.height}; set the camera to that size or calibrate at this one"
            )


def save(calibration: CameraCalibration, path: Path) -> None:
    """Writes a calibration to a file; raises OutputError if the file cannot be written."""
    view, trust = calibration.view, calibration.trust
    lens = view.lens
    body = {
        "camera": calibration.camera,
        "date": calibration.date,
        "width_px": lens.width,
        "height_px": lens.height,
        "focal_px": list(lens.focal),
        "centre_px": list(lens.centre),
        "distortion_k1_k2_p1_p2_k3": list(lens.distortion),
        "rotation_world_to_camera": view.rotation.tolist(),
        "translation_mm": view.translation.tolist(),
        "board_views": calibration.views,
        "board_rms_px": calibration.rms_px,
        "alignment_rms_mm": calibration.alignment_mm,
        "references": [reference._asdict() for reference in calibration.references],
        "trust_x_mm": trust.x_mm.tolist(),
        "trust_y_mm": trust.y_mm.tolist(),
        "trust_sigma_mm": np.round(trust.sigma_mm, 5).tolist(),
    }
    documents.save(path, KIND, body)


def load(path: Path) -> CameraCalibration:
    """Reads a calibration from a file; raises InputError if it is unreadable, changed or of another kind."""
    return documents.read(path, KIND, REMEDY, _parsed)


def _parsed(record: dict[str, Any]) -> CameraCalibration:
    fx, fy = map(float, record["focal_px"])
    cx, cy = map(float, record["centre_px"])
    k1, k2, p1, p2, k3 = map(float, record["distortion_k1_k2_p1_p2_k3"])
    width, height = int(record["width_px"]), int(record["height_px"])
    lens = Lens(width, height, (fx, fy), (cx, cy), (k1, k2, p1, p2, k3))
    rotation = np.array(record["rotation_world_to_camera"], np.float64).reshape(3, 3)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6:
        raise ValueError("rotation_world_to_camera is not a rotation")
    view = View(lens, rotation, np.array(record["translation_mm"], np.float64).reshape(3))
    grid = (record[f"trust_{name}_mm"] for name in ("x", "y", "sigma"))
    trust = Trust(*(np.array(values, np.float64) for values in grid))
    if trust.sigma_mm.shape != (len(trust.y_mm), len(trust.x_mm)) or min(trust.sigma_mm.shape) < 2:
        raise ValueError("its grid of trust has another shape than its axes")
    references = tuple(
        Reference(int(tag["number"]), float(tag["x_mm"]), float(tag["y_mm"]))
        for tag in record["references"]
    )
    camera, date, views = str(record["camera"]), str(record["date"]), int(record["board_views"])
    errors = float(record["board_rms_px"]), float(record["alignment_rms_mm"])
    return CameraCalibration(camera, date, view, *errors, trust, references, views)
