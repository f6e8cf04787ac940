"""Pose of the camera, from a board on the table and from places that the arm has touched."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from drivers.camera.calibration.file import Trust
from drivers.camera.calibration.lens_fit import LensFit, slopes_at
from drivers.camera.vision.arrays import Array
from drivers.camera.vision.board import BoardView
from drivers.camera.vision.lens import Lens
from drivers.camera.vision.plane import View, as_it_lies, placed, rigid_fit
from drivers.planar import Pose2, relative
from runtime.shell.errors import InputError

Place = tuple[float, float]
LEAST_TOUCHED = 3
LEAST_SPREAD_MM = 50.0
LARGEST_ALIGNMENT_MM = 1.0
LARGEST_RESIDUAL_MM = 0.5
GRID = (17, 11)  # grid of the uncertainty, across and down the picture


class Residuals(NamedTuple):
    """Fitted corners of boards on the table, and the deviations of measured corners from the fitted ones."""

    places: Array  # (n, 2) fitted corners, mm
    off: Array  # (n, 2) deviations of the measured corners, mm

    @property
    def rms_mm(self) -> float:
        """Root mean square deviation of the corners, mm."""
        return float(np.sqrt(np.mean(np.sum(self.off**2, axis=1))))


def stand(lens: Lens, pose: Array, from_below: bool, height_mm: float = 0.0) -> View:
    """Computes the camera's view in a world given by the board that lies on the table.

    The origin of the world is on the table, below the board's middle; x points to the right of the print.

    Args:
        lens: the lens.
        pose: (6,) pose of the board in the camera: rotation vector and translation, rad and mm.
        from_below: whether the camera looks up through the table, at a board that lies face down.
        height_mm: height of the board's face above the table.
    """
    turn, _ = cv2.Rodrigues(np.asarray(pose[:3], np.float64))
    # A board's third axis points away from its reader: up if it lies face down.
    lies = np.diag([1.0, 1.0, 1.0]) if from_below else np.diag([1.0, -1.0, -1.0])
    rotation = np.asarray(turn, np.float64) @ lies
    return View(lens, rotation, pose[3:] - rotation @ np.array([0.0, 0.0, height_mm]))


def align(touched: Sequence[Place], seen: Sequence[Place]) -> tuple[Pose2, float]:
    """Computes the pose of the arm's world in the board's frame, from places known in both frames.

    Args:
        touched: places in the arm's world, mm.
        seen: the same places in the board's frame, mm.

    Returns:
        The pose (mm, mm, rad), and the rms of the residuals, mm.

    Raises:
        InputError: there are too few places, they are too close together, or they contradict one another.
    """
    a, b = np.array(touched, np.float64).reshape(-1, 2), np.array(seen, np.float64).reshape(-1, 2)
    if len(a) < LEAST_TOUCHED:
        raise InputError(f"{len(a)} touched places; the arm has to touch at least {LEAST_TOUCHED}")
    spread = float(np.hypot(*(a.max(axis=0) - a.min(axis=0))))
    if spread < LEAST_SPREAD_MM:
        raise InputError(
            f"the touched places are within {spread:.0f} mm; spread them over {LEAST_SPREAD_MM:g} mm and more"
        )
    result = rigid_fit(a, b)
    if result.rms_mm > LARGEST_ALIGNMENT_MM:
        raise InputError(
            f"touched and seen places disagree by {result.rms_mm:.2f} mm "
            f"(limit {LARGEST_ALIGNMENT_MM:g} mm); "
            "check which picture belongs to which place, the arm's tool frame, and --above"
        )
    return result.pose, result.rms_mm


def board_residuals(view: View, boards: Sequence[BoardView], height_mm: float = 0.0) -> Residuals:
    """Fits the pose of each board on the table; returns the deviations of its measured corners from the fit.

    Raises:
        InputError: the rms deviation is too large.
    """
    places, off = [], []
    for board in boards:
        seen = view.on_plane(board.pixels, height_mm)
        points = as_it_lies(board.points, view.from_below)
        whole = placed(points, rigid_fit(points, seen).pose)
        places.append(whole)
        off.append(seen - whole)
    result = Residuals(np.concatenate(places), np.concatenate(off))
    if not result.rms_mm <= LARGEST_RESIDUAL_MM:
        raise InputError(
            f"boards on the table are measured {result.rms_mm:.2f} mm wrong (limit {LARGEST_RESIDUAL_MM:g}"
            " mm); check that they lie flat, and the board's measures"
        )
    return result


def trust(fitted: LensFit, view: View, height_mm: float, world: Pose2) -> Trust:
    """Computes the standard deviation of measured places on a grid over the visible part of the table.

    If lens and pose of the camera vary by their covariance, a fixed pixel shows varying places on the table.
    The result is the standard deviation of these places in the worst direction.

    Args:
        fitted: lens and the table board's pose, with their covariance.
        view: view of the camera in the arm's world.
        height_mm: height of the board's face above the table.
        world: pose of the arm's world in the board's frame.

    Raises:
        InputError: the picture reaches beyond the horizon of the table.
    """
    lens, below = view.lens, view.from_below
    rim = np.array([(x, y) for x in (0, lens.width - 1) for y in (0, lens.height - 1)], np.float64)
    corners = view.on_plane(rim)
    if not np.isfinite(corners).all():
        problem = (
            "a corner of the picture lies beyond the horizon of the table; tilt the camera less"
        )
        raise InputError(problem)
    low, high = corners.min(axis=0), corners.max(axis=0)
    x_mm, y_mm = (np.linspace(low[k], high[k], GRID[k]) for k in (0, 1))
    places = placed(np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2), world)
    deep = np.full(len(places), -height_mm if below else height_mm)
    slopes = slopes_at(lens, fitted.pose, np.column_stack([as_it_lies(places, below), deep]))
    slopes = slopes.reshape(-1, 2, slopes.shape[1])
    turn, _ = cv2.Rodrigues(fitted.pose[:3])
    moved = np.linalg.solve(slopes[:, :, -3:] @ np.asarray(turn, np.float64)[:, :2], slopes)
    spread = moved @ fitted.covariance @ moved.transpose(0, 2, 1)
    worse = np.sqrt(np.linalg.eigvalsh(spread)[:, 1])
    return Trust(x_mm, y_mm, worse.reshape(len(y_mm), len(x_mm)))


def part_offset(parts: Sequence[Pose2], tags: Sequence[Pose2]) -> tuple[Pose2, float, float]:
    """Averages the pose of a tag in the frame of its part.

    Args:
        parts: known poses of the part.
        tags: poses of the tag as measured, in the same order.

    Returns:
        The mean pose (mm, mm, rad), and the standard deviations of its place (mm) and angle (rad).

    Raises:
        InputError: there are too few poses, or they contradict one another.
    """
    if len(parts) < LEAST_TOUCHED:
        raise InputError(f"{len(parts)} poses of the part; at least {LEAST_TOUCHED} are needed")
    result = np.array([relative(part, tag) for part, tag in zip(parts, tags, strict=True)])
    theta = float(np.angle(np.mean(np.exp(1j * result[:, 2]))))
    place = result[:, :2].mean(axis=0)
    count = len(result)
    scatter = np.sqrt(np.sum((result[:, :2] - place) ** 2) / (2 * (count - 1)))
    turned = np.remainder(result[:, 2] - theta + np.pi, 2.0 * np.pi) - np.pi
    if scatter > LARGEST_ALIGNMENT_MM:
        raise InputError(
            f"the tag's place on the part scatters by {scatter:.2f} mm (limit {LARGEST_ALIGNMENT_MM:g} mm); "
            "check the part's poses and the order of the pictures"
        )
    sigma_rad = float(np.sqrt(np.sum(turned**2) / (count - 1) / count))
    return (float(place[0]), float(place[1]), theta), float(scatter / np.sqrt(count)), sigma_rad
