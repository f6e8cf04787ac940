"""Fits a lens, with its covariance, to views of a board, by OpenCV's bundle adjustment."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from drivers.camera.vision.arrays import Array
from drivers.camera.vision.board import BoardView
from drivers.camera.vision.lens import Lens
from runtime.shell.errors import InputError

LEAST_VIEWS = 8
LARGEST_RMS_PX = 0.5
LARGEST_VIEW_RMS_PX = 1.0
LARGEST_FOCAL_SIGMA = 0.005  # standard deviation, as a share of the focal length
# Extent of the four corners of a picture, as a share of its width and height; in each a board must be seen.
CORNER_SHARE = 0.22
INTRINSICS = 9


class LensFit(NamedTuple):
    """Result of `fit`: lens, pose of the table's board in the camera's frame, and covariance of both."""

    lens: Lens  # the lens
    pose: Array  # (6,) rotation vector and translation of the first board in the camera, rad and mm
    rms_px: float  # residual over all corners of all views, both coordinates together
    covariance: Array  # (15, 15) covariance of the nine intrinsics and the pose


def fit(views: Sequence[BoardView], size: tuple[int, int]) -> LensFit:
    """Fits a lens to views of a board; in the first view the board lies on the table.

    `size` is width and height of the pictures, in pixels.

    Raises:
        InputError: there are too few views or too little tilt, the board was never near one of the picture's
            corners, or residuals are large.
    """
    _check_views(views, size)
    points = [np.column_stack([v.points, np.zeros(len(v.points))]) for v in views]
    pixels = [v.pixels.astype(np.float32).reshape(-1, 1, 2) for v in views]
    rms, matrix, distortion, turns, shifts, *_, view_rms = cv2.calibrateCameraExtended(
        [solid.astype(np.float32) for solid in points], pixels, size, np.eye(3), np.zeros(5)
    )
    _check_residuals(float(rms), np.ravel(view_rms), views)
    (fx, _, cx), (_, fy, cy), _ = np.asarray(matrix, np.float64).tolist()
    k1, k2, p1, p2, k3 = map(float, np.ravel(distortion)[:5])
    lens = Lens(*size, (fx, fy), (cx, cy), (k1, k2, p1, p2, k3))
    poses = np.hstack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))])
    slopes = [slopes_at(lens, pose, solid) for pose, solid in zip(poses, points, strict=True)]
    covariance = float(rms) ** 2 * _cofactor(slopes)
    sigma = float(np.sqrt(max(covariance[0, 0], covariance[1, 1]))) / fx
    if not sigma <= LARGEST_FOCAL_SIGMA:
        raise InputError(
            f"the focal length is known to {100 * sigma:.1f} % only (limit {100 * LARGEST_FOCAL_SIGMA:g} %); "
            "add views with the board tilted by 30 degrees and more"
        )
    return LensFit(lens, poses[0], float(rms), covariance)


def slopes_at(lens: Lens, pose: Array, points: Array) -> Array:
    """Computes the derivatives of pixels with respect to the nine intrinsics and the pose of a board.

    Args:
        lens: the lens.
        pose: (6,) pose of the board in the camera: rotation vector and translation, rad and mm.
        points: (n, 3) points in the board's frame, mm.

    Returns:
        (2 n, 15): columns of the intrinsics, of the rotation vector (rad) and of the translation (mm).
    """
    bent = np.array(lens.distortion)
    _, slopes = cv2.projectPoints(points, pose[:3], pose[3:], lens.matrix, bent)
    return np.roll(np.asarray(slopes, np.float64), INTRINSICS, axis=1)  # OpenCV has the pose first


def _check_views(views: Sequence[BoardView], size: tuple[int, int]) -> None:
    if len(views) < LEAST_VIEWS:
        raise InputError(
            f"{len(views)} pictures show the board; take at least {LEAST_VIEWS}, tilted to all sides, "
            "and in all corners of the picture"
        )
    seen = np.concatenate([view.pixels for view in views]) / size
    for down, vertical in ((0, "upper"), (1, "lower")):
        for right, horizontal in ((0, "left"), (1, "right")):
            near = np.abs(seen - (right, down)) < CORNER_SHARE
            if not near.all(axis=1).any():
                raise InputError(
                    f"no view shows the board in the {vertical} {horizontal} corner of the picture; "
                    "add one there"
                )


def _check_residuals(rms_px: float, view_rms_px: Array, views: Sequence[BoardView]) -> None:
    worst = int(np.argmax(view_rms_px))
    if rms_px > LARGEST_RMS_PX or view_rms_px[worst] > LARGEST_VIEW_RMS_PX:
        raise InputError(
            f"the residual is {rms_px:.2f} px (limit {LARGEST_RMS_PX:g}), worst "
            f"{view_rms_px[worst]:.2f} px in {views[worst].name}; leave that one out, keep the board "
            "flat and still, and check its measures"
        )


def _cofactor(slopes: Sequence[Array]) -> Array:
    """Computes the covariance of the intrinsics and the first pose, (15, 15), for residuals of unit rms.

    The poses of the other views are eliminated by Schur complements.
    """
    normal = slopes[0].T @ slopes[0]
    for other in slopes[1:]:
        block = other.T @ other
        lens_part, cross, pose_part = block[:9, :9], block[:9, 9:], block[9:, 9:]
        normal[:9, :9] += lens_part - cross @ np.linalg.solve(pose_part, cross.T)
    residuals = sum(map(len, slopes))
    freedom = max(residuals - INTRINSICS - 6 * len(slopes), 1)
    scale = np.sqrt(np.diag(normal))  # parameters of very different sizes
    inverse = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return np.asarray(0.5 * residuals / freedom * inverse)
