"""Measures a part's pose, with its uncertainty, from one picture."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from drivers.camera.calibration.file import CameraCalibration
from drivers.camera.vision import explain
from drivers.camera.vision.arrays import Array, Picture
from drivers.camera.vision.plane import as_it_lies, rigid_fit
from drivers.camera.vision.tag_file import PartTag
from drivers.camera.vision.tags import Sighting
from drivers.errors import PictureError
from drivers.planar import Pose2, compose, relative

LEAST_CORNER_PX = 0.05  # least standard deviation of a corner
HEIGHT_SIGMA_MM = 0.1  # standard deviation of the height of a tag above the table
LARGEST_SCALE_ERROR = 0.02  # greatest relative error of the measured size of a tag


class Measured(NamedTuple):
    """Pose of a part as the camera measured it, with standard deviations."""

    pose: Pose2  # x, y, theta of the part: mm, mm, rad
    sigma_mm: float  # standard deviation of the part's place
    sigma_rad: float  # standard deviation of the part's angle
    tag: Sighting  # the tag in the picture


def measure(
    picture: Picture,
    seen: Sequence[Sighting],
    calibration: CameraCalibration,
    tag: PartTag,
    near: Pose2 | None = None,
) -> Measured:
    """Measures the part's pose by its tag, which has to be the only tag in view apart from the fixed tags.

    Args:
        picture: the picture (h, w); used only to explain why the tag is not seen.
        seen: all tags in the picture.
        calibration: the camera's calibration.
        tag: the part's tag.
        near: expected pose of the part, if known; used only to explain why the tag is not seen.

    Raises:
        PictureError: the tag is not seen, another tag is in view that is not fixed, or the tag has the wrong
            size.
    """
    fixed = {reference.number for reference in calibration.references}
    sighting = the_one(seen, tag.number, fixed)
    if sighting is None:
        expected = None if near is None else compose(near, tag.on_part)
        raise PictureError(explain.why_unseen(picture, calibration.view, tag, expected))
    return of_sighting(sighting, calibration, tag)


def of_sighting(sighting: Sighting, calibration: CameraCalibration, tag: PartTag) -> Measured:
    """Measures the part's pose from the corners of its tag.

    Raises:
        PictureError: the tag has the wrong size, or is seen beyond the table's horizon.
    """
    view = calibration.view
    corners = view.on_plane(sighting.corners, tag.height_mm)
    if not np.isfinite(corners).all():
        raise PictureError(
            f"tag {tag.number} is seen beyond the table's horizon, where nothing lies; check that it is the "
            "part's, and that the camera stands where it was calibrated"
        )
    fit = rigid_fit(as_it_lies(print_corners(tag.side_mm), view.from_below), corners)
    if not abs(fit.scale - 1.0) <= LARGEST_SCALE_ERROR:
        raise PictureError(
            f"tag {tag.number} looks {fit.scale * tag.side_mm:.2f} mm large and should be {tag.side_mm:g}; "
            "check its size and height, and calibrate the camera again if both are right"
        )
    pose = compose(fit.pose, relative(tag.on_part, (0.0, 0.0, 0.0)))
    sigma_mm, sigma_rad = _spread(sighting, corners, calibration, tag)
    return Measured(pose, sigma_mm, sigma_rad, sighting)


def print_corners(side_mm: float) -> Array:
    """Corners (4, 2) of a printed tag, mm from its middle, x right, y down, ordered as `Sighting.corners`."""
    return 0.5 * side_mm * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def the_one(seen: Sequence[Sighting], number: int, fixed: Collection[int]) -> Sighting | None:
    """Returns the sighting of the part's tag, `number`; None if only fixed tags, or no tags, are seen.

    Raises:
        PictureError: apart from the fixed tags, several tags are seen, or one with another number.
    """
    loose = [tag for tag in seen if tag.number not in fixed]
    ours = [tag for tag in loose if tag.number == number]
    others = sorted({tag.number for tag in loose} - {number})
    if len(loose) > 1:
        named = f"{len(ours)} times tag {number}"
        if others:
            named = ", ".join(str(tag.number) for tag in loose)
        raise PictureError(f"more than one tag lies in view ({named}); leave one part on the table")
    if others:
        raise PictureError(
            f"tag {others[0]} is seen, but the part carries tag {number}; is it the right part?"
        )
    return ours[0] if ours else None


def _spread(
    sighting: Sighting, corners: Array, calibration: CameraCalibration, tag: PartTag
) -> tuple[float, float]:
    """Standard deviations of a part's place (mm) and angle (rad).

    They combine the errors of the corners, the calibration, the tag's height, and its pose on the part.
    """
    side_px = float(np.mean(np.hypot(*(sighting.corners - np.roll(sighting.corners, 1, axis=0)).T)))
    corner_mm = max(sighting.rms_px, LEAST_CORNER_PX) * tag.side_mm / side_px
    middle = corners.mean(axis=0)
    calibrated_mm = calibration.trust.at(float(middle[0]), float(middle[1]))
    eye = calibration.view.eye
    slant = float(np.hypot(*(middle - eye[:2]))) / max(abs(float(eye[2]) - tag.height_mm), 1.0)
    turned = np.hypot(corner_mm / (np.sqrt(2.0) * tag.side_mm), tag.sigma_rad)
    lever_mm = float(np.hypot(*tag.on_part[:2]))
    height_mm, glued_mm = HEIGHT_SIGMA_MM * slant, turned * lever_mm
    terms = (0.5 * corner_mm, calibrated_mm, height_mm, tag.sigma_mm, glued_mm)
    return float(np.sqrt(np.sum(np.square(terms)))), float(turned)
