"""Explains why nothing can be measured in a picture, with a remedy."""

import cv2
import numpy as np

from drivers.camera.vision.arrays import Array, Picture
from drivers.camera.vision.plane import View, as_it_lies, placed
from drivers.camera.vision.tag_file import PartTag
from drivers.camera.vision.tags import FAMILY, SQUARES, families_seen
from drivers.errors import PictureError
from drivers.planar import Pose2

BLACK_LEVEL = 16
WHITE_LEVEL = 250
LEAST_RANGE = 24
SEARCH_MM = 20.0
PX_PER_SQUARE = 6
LIKE_PART_OF_A_TAG = 0.8


def check_exposure(picture: Picture) -> None:
    """Raises a PictureError if a picture shows nothing: it is black, white or plain grey."""
    low, high = np.percentile(picture[::8, ::8], (1.0, 99.0))
    if high < BLACK_LEVEL:
        raise PictureError("the picture is black; check the light, the lens cap and the exposure")
    if low > WHITE_LEVEL:
        raise PictureError("the picture is white; lower the exposure or the light")
    if high - low < LEAST_RANGE and float(picture.max()) - float(picture.min()) < 2 * LEAST_RANGE:
        raise PictureError("the picture is of one grey; check the view and the focus")


def why_unseen(picture: Picture, view: View, tag: PartTag, expected: Pose2 | None) -> str:
    """Returns the message for a tag that is not seen.

    Args:
        picture: the picture, (h, w) grey levels.
        view: view of the camera.
        tag: the part's tag.
        expected: expected pose of the tag, if known: mm, mm, rad.
    """
    if families := families_seen(picture):
        return f"no tag {FAMILY} is seen, but one of family {families[0]}; print tag {tag.number} of {FAMILY}"
    if expected is not None and _partly_seen(picture, view, tag, expected):
        return f"tag {tag.number} is partly covered; all four of its sides must be seen"
    return f"no tag is seen; tag {tag.number} must be in view, whole, in focus and lit"


def _partly_seen(picture: Picture, view: View, tag: PartTag, expected: Pose2) -> bool:
    """Whether any of the four quarters of a tag is seen near its expected place."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    drawn = cv2.aruco.generateImageMarker(family, tag.number, SQUARES * PX_PER_SQUARE)
    pattern = np.pad(drawn, PX_PER_SQUARE, constant_values=255)
    flat = _flattened(picture, view, tag, expected, len(pattern))
    if flat is None:
        return False
    half = len(pattern) // 2
    quarters = (pattern[y : y + half, x : x + half] for y in (0, half) for x in (0, half))
    solid = map(np.ascontiguousarray, quarters)
    scores = (cv2.matchTemplate(flat, part, cv2.TM_CCOEFF_NORMED).max() for part in solid)
    return max(map(float, scores)) >= LIKE_PART_OF_A_TAG


def _flattened(
    picture: Picture, view: View, tag: PartTag, expected: Pose2, across: int
) -> Picture | None:
    """Rectifies the plane around the expected place of the tag, to the scale and orientation of the print.

    `across` is the width of the tag's pattern, px. Returns None if the lens cannot show the whole region.
    """
    mm_per_px = tag.side_mm / (SQUARES * PX_PER_SQUARE)
    size = across + 2 * round(SEARCH_MM / mm_per_px)
    steps = (np.arange(size) - 0.5 * (size - 1)) * mm_per_px
    prints: Array = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    pixels = view.pixels_at(placed(as_it_lies(prints, view.from_below), expected), tag.height_mm)
    if not np.isfinite(pixels).all():
        return None
    x, y = (np.ascontiguousarray(pixels[:, k].reshape(size, size), np.float32) for k in (0, 1))
    return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR), np.uint8)
