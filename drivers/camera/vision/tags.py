"""Detection of tags: OpenCV detects and reads them, `drivers.camera.vision.edges` refines their corners.

OpenCV's own refinements are not used. Where squares are small, the sub-pixel refinement searches within about
a pixel only. AprilTag's refinement takes a second per picture, and places a pixel's origin at its corner
instead of its centre.
"""

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from drivers.camera.vision import edges
from drivers.camera.vision.arrays import Array, Picture

FAMILY = "36h11"
SQUARES = 8  # squares along a side of a 36h11 tag, its black border included
RIM = 24  # padding in pixels, since tags near the edge of a picture are missed otherwise
OTHER_FAMILIES: dict[str, int] = {
    "25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "36h10": cv2.aruco.DICT_APRILTAG_36h10,
    "16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "ArUco 4x4": cv2.aruco.DICT_4X4_250,
    "ArUco 5x5": cv2.aruco.DICT_5X5_250,
    "ArUco 6x6": cv2.aruco.DICT_6X6_250,
    "ArUco original": cv2.aruco.DICT_ARUCO_ORIGINAL,
}


class Sighting(NamedTuple):
    """A tag in a picture."""

    number: int  # id of the tag
    corners: Array  # (4, 2) pixels: upper left, upper right, lower right, lower left of the print
    rms_px: float  # rms distance of the edge points from the straight sides


def find(picture: Picture) -> list[Sighting]:
    """Detects all tags of `FAMILY` whose four sides are seen; returns them sorted by id."""
    results = []
    for number, corners in _read(cv2.aruco.DICT_APRILTAG_36h11, picture):
        refined = edges.refine(picture, corners, SQUARES)
        if refined is not None:
            results.append(Sighting(number, *refined))
    return sorted(results, key=lambda tag: tag.number)


def families_seen(picture: Picture) -> list[str]:
    """Names the `OTHER_FAMILIES` seen in a picture; slow, only to explain why no tag of `FAMILY` is seen."""
    return [name for name, code in OTHER_FAMILIES.items() if any(_read(code, picture))]


def _read(dictionary: int, picture: Picture) -> Iterable[tuple[int, Array]]:
    """Detects the tags of one OpenCV dictionary; returns the id and the coarse corners (4, 2) of each.

    OpenCV 4 and 5 return arrays of corners of different shapes, and None if there are no tags.
    """
    soft = cv2.GaussianBlur(picture, (3, 3), 0.0)
    padded = cv2.copyMakeBorder(soft, RIM, RIM, RIM, RIM, cv2.BORDER_REPLICATE)
    corners, ids, _ = _detector(dictionary).detectMarkers(padded)
    if ids is None or len(corners) == 0:
        return []
    quads = [np.asarray(quad, np.float64).reshape(4, 2) - RIM for quad in corners]
    return list(zip(map(int, np.ravel(ids)), quads, strict=True))


@cache
def _detector(dictionary: int) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    # The smallest window (3) detects sensor noise, thousands of contours of it, and no tag.
    parameters.adaptiveThreshWinSizeMin = 13
    parameters.adaptiveThreshWinSizeMax = 33
    parameters.adaptiveThreshWinSizeStep = 20
    # With this tolerance, an outline extended by a stain of one square still has four corners.
    parameters.polygonalApproxAccuracyRate = 0.05
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(dictionary), parameters)
