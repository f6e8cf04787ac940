"""Drift of the camera: fixed tags must be where they were at the calibration."""

from collections.abc import Sequence
from math import dist, isfinite

from drivers.camera.calibration.file import Reference
from drivers.camera.vision.plane import View
from drivers.camera.vision.tags import Sighting
from drivers.errors import PictureError

LIMIT_MM = 0.5  # usual limit of the motion of a reference tag


def check(
    references: Sequence[Reference], seen: Sequence[Sighting], view: View, limit_mm: float
) -> float:
    """Checks that the reference tags are where they were at the calibration.

    Args:
        references: tags with their places at the calibration; empty: nothing is checked.
        seen: all tags in the picture.
        view: view of the calibration.
        limit_mm: largest tolerated motion.

    Returns:
        The greatest motion of a reference tag, mm.

    Raises:
        PictureError: a reference tag has moved farther or is seen beyond the table's horizon, or no
            reference tag is seen.
    """
    if not references:
        return 0.0
    places = {tag.number: place(tag, view) for tag in seen}
    moved = [(dist(places[number], was), number) for number, *was in references if number in places]
    if not moved:
        names = ", ".join(str(reference.number) for reference in references)
        raise PictureError(
            f"no reference tag ({names}) is seen, so the camera may have moved; uncover them"
        )
    beyond = [number for off_mm, number in moved if not isfinite(off_mm)]
    if beyond:
        raise PictureError(
            f"reference tag {beyond[0]} is seen beyond the table's horizon: the camera or the tag moved; "
            "calibrate again"
        )
    worst_mm, number = max(moved)
    if worst_mm > limit_mm:
        raise PictureError(
            f"reference tag {number} is {worst_mm:.2f} mm from where it was (limit {limit_mm:g} mm): "
            "the camera or the tag moved; calibrate again"
        )
    return worst_mm


def place(tag: Sighting, view: View) -> tuple[float, float]:
    """Returns the middle of a tag on the table, x and y in mm: the intersection of its diagonals."""
    a, b, c, d = view.on_plane(tag.corners)
    (px, py), (qx, qy) = c - a, d - b
    reach = ((b[0] - a[0]) * qy - (b[1] - a[1]) * qx) / (px * qy - py * qx)
    return float(a[0] + reach * px), float(a[1] + reach * py)
