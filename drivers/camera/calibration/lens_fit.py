"""A lens from views of a board: OpenCV's bundle adjustment, and how sure one may be of it.

The covariance of the lens and of the table's pose follows from the same equations, with the poses of all
other views eliminated (Schur complement); the tool reads from it how far places on the table may be trusted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from drivers.camera.errors import CalibrationRefusedError
from drivers.camera.vision.arrays import Array
from drivers.camera.vision.board import BoardView
from drivers.camera.vision.lens import Lens
from drivers.camera.vision.plane import View

LEAST_VIEWS = 8
LARGEST_RMS_PX = 0.5
LARGEST_VIEW_RMS_PX = 1.0
LARGEST_FOCAL_SIGMA = 0.005  # of the focal length
CORNER_SHARE = 0.22  # of width and height: a corner of the picture, which some view has to reach
STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-2, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5, *[1e-6] * 3, *[1e-3] * 3])
INTRINSICS = 9


class LensFit(NamedTuple):
    """A lens, the board's pose in each view, and their uncertainty.

    Attributes:
        lens: the lens.
        poses: (views, 6) rotation vector and translation of each board in the camera, rad and mm.
        rms_px: over all corners, both coordinates together.
        view_rms_px: (views,) the same of each view.
        covariance: (15, 15) of the nine intrinsics and of the first view's pose.
    """

    lens: Lens
    poses: Array
    rms_px: float
    view_rms_px: Array
    covariance: Array


def fit(views: Sequence[BoardView], size: tuple[int, int]) -> LensFit:
    """Fit a lens to views of a board, the first of which lies on the table.

    Args:
        views: at least `LEAST_VIEWS`.
        size: width and height of the pictures.

    Raises:
        CalibrationRefusedError: too few views, a corner without any, large residuals, little tilt.
    """
    check_views(views, size)
    points = [np.column_stack([v.points, np.zeros(len(v.points))]).astype(np.float32) for v in views]
    pixels = [v.pixels.astype(np.float32).reshape(-1, 1, 2) for v in views]
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(points, pixels, size, np.eye(3), np.zeros(5))[
        :5
    ]
    k1, k2, p1, p2, k3 = map(float, np.ravel(distortion)[:5])
    matrix = np.asarray(matrix, np.float64)
    values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], k1, k2, p1, p2, k3)
    lens = Lens(*size, (1.0, 1.0), (0.0, 0.0), (0.0,) * 5).with_parameters(np.array(values))
    poses = np.array([[*np.ravel(r), *np.ravel(t)] for r, t in zip(turns, shifts, strict=True)], np.float64)
    left = [projected(lens, pose, v.points) - v.pixels for pose, v in zip(poses, views, strict=True)]
    rms = np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in left])
    total = float(np.sqrt(np.mean(np.sum(np.concatenate(left) ** 2, axis=1))))
    found = LensFit(lens, poses, total, rms, _covariance(lens, poses, views, left))
    check_fit(found, views)
    return found


def projected(lens: Lens, pose: Array, points: Array) -> Array:
    """Where points of a board at a pose are seen, (n, 2) mm -> (n, 2) pixels."""
    rotation, _ = cv2.Rodrigues(np.asarray(pose[:3], np.float64))
    view = View(lens, np.asarray(rotation, np.float64), pose[3:])
    return view.pixels(np.column_stack([points, np.zeros(len(points))]))


def check_views(views: Sequence[BoardView], size: tuple[int, int]) -> None:
    """Check that there are enough views, and that they reach the corners of the picture.

    Raises:
        CalibrationRefusedError: they do not.
    """
    if len(views) < LEAST_VIEWS:
        raise CalibrationRefusedError(
            f"{len(views)} pictures show the board; take at least {LEAST_VIEWS}, tilted to all sides, "
            "and in all corners of the picture"
        )
    seen = np.concatenate([view.pixels for view in views]) / size
    for down, vertical in ((0, "upper"), (1, "lower")):
        for right, horizontal in ((0, "left"), (1, "right")):
            near = np.abs(seen - (right, down)) < CORNER_SHARE
            if not near.all(axis=1).any():
                raise CalibrationRefusedError(
                    f"no view shows the board in the {vertical} {horizontal} corner of the picture; "
                    "add one there"
                )


def check_fit(found: LensFit, views: Sequence[BoardView]) -> None:
    """Check that the lens explains the views, and that the views tell the lens.

    Raises:
        CalibrationRefusedError: they do not.
    """
    worst = int(np.argmax(found.view_rms_px))
    if found.rms_px > LARGEST_RMS_PX or found.view_rms_px[worst] > LARGEST_VIEW_RMS_PX:
        raise CalibrationRefusedError(
            f"the residual is {found.rms_px:.2f} px (limit {LARGEST_RMS_PX:g}), worst "
            f"{found.view_rms_px[worst]:.2f} px in {views[worst].name}; leave that one out, keep the board "
            "flat and still, and check its measures"
        )
    sigma = float(np.sqrt(max(found.covariance[0, 0], found.covariance[1, 1]))) / found.lens.focal[0]
    if not sigma <= LARGEST_FOCAL_SIGMA:
        raise CalibrationRefusedError(
            f"the focal length is known to {100 * sigma:.1f} % only (limit {100 * LARGEST_FOCAL_SIGMA:g} %); "
            "add views with the board tilted by 30 degrees and more"
        )


def _covariance(lens: Lens, poses: Array, views: Sequence[BoardView], left: Sequence[Array]) -> Array:
    size = INTRINSICS + 6
    normal = np.zeros((size, size))
    for number, (pose, view) in enumerate(zip(poses, views, strict=True)):
        slopes = _slopes(lens, pose, view.points)
        block = slopes.T @ slopes
        if number == 0:
            normal += block
        else:
            lens_part, cross, pose_part = block[:9, :9], block[:9, 9:], block[9:, 9:]
            normal[:9, :9] += lens_part - cross @ np.linalg.solve(pose_part, cross.T)
    residuals = np.concatenate(left).ravel()
    freedom = max(len(residuals) - INTRINSICS - 6 * len(views), 1)
    scale = np.sqrt(np.diag(normal))  # parameters of very different sizes
    inverse = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return np.asarray(float(residuals @ residuals) / freedom * inverse)


def _slopes(lens: Lens, pose: Array, points: Array) -> Array:
    """Derivatives of all pixels by intrinsics and pose, (2 n, 15), by central differences."""
    values = np.concatenate([lens.parameters, pose])
    columns = []
    for index, step in enumerate(STEPS):
        moved = []
        for sign in (1.0, -1.0):
            at = values.copy()
            at[index] += sign * step
            moved.append(projected(lens.with_parameters(at[:9]), at[9:], points))
        columns.append(((moved[0] - moved[1]) / (2.0 * step)).ravel())
    return np.stack(columns, axis=1)
