"""The overlay of an audit: predicted pose, measured pose and sentence on the picture."""

import contextlib
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.audit.subject import Subject
from drivers.camera.calibration.measure import Measured, print_corners
from drivers.camera.vision.arrays import Array, Picture
from drivers.camera.vision.plane import View, as_it_lies, placed
from drivers.planar import Pose2
from runtime.shell.files import writing

# Okabe and Ito's vermilion and blue, in OpenCV's order of colours; distinguishable for colour-blind
# readers.
PREDICTED = (0, 94, 213)
MEASURED = (178, 114, 0)
WHITE = (255, 255, 255)
FRACTION_BITS = 4
MOST_PICTURES = 1000
QUALITY = 85


def keep(folder: Path, part: int, verdict: str, drawn: Picture) -> Path | None:
    """Writes an overlay to a file; first deletes the oldest ones, so that at most `MOST_PICTURES` remain.

    Args:
        folder: folder of overlays; created if missing.
        part: number of the part.
        verdict: verdict on the part.
        drawn: the overlay, (h, w, 3).

    Returns:
        The file; None if it cannot be written, which is no error: an audit does not depend on overlays.
    """
    path = folder / f"part-{part:07d}-{verdict}.jpg"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        kept = sorted(folder.glob("part-*.jpg"), key=lambda old: (old.lstat().st_mtime_ns, old))
        for old in kept[: max(0, len(kept) - MOST_PICTURES + 1)]:
            old.unlink(missing_ok=True)
        _, coded = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        with writing(path) as draft:
            draft.write_bytes(coded.tobytes())
    except OSError:
        return None
    return path


def draw(
    picture: Picture,
    view: View,
    subject: Subject,
    predicted: Pose2,
    measured: Measured | None,
    sentence: str,
) -> Picture:
    """Draws the part at its predicted and its measured pose, and a sentence, over a picture.

    Args:
        picture: (h, w) as taken.
        view: lens and pose of the camera.
        subject: the part's outline and tag.
        predicted: pose that the leaf states, mm, mm, rad.
        measured: the measurement; None: there is none, and only the predicted pose is drawn.
        sentence: verdict and reason, written along the lower edge.

    Returns:
        The drawing, (h, w, 3), blue first.
    """
    canvas = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)
    outline = subject.outline_mm
    if outline is None:
        outline = as_it_lies(print_corners(subject.tag.side_mm), view.from_below)
    _closed(canvas, view.pixels_at(placed(outline, predicted)), PREDICTED)
    if measured is not None:
        _closed(canvas, view.pixels_at(placed(outline, measured.pose)), MEASURED)
        _closed(canvas, measured.tag.corners, MEASURED)
    # A band instead of outlined letters: letters of another weight are wider in some versions of
    # OpenCV.
    size, height = canvas.shape[1] / 1920.0, canvas.shape[0]
    canvas[height - round(60 * size) :] //= 4
    where, width = (round(20 * size), height - round(22 * size)), max(1, round(2 * size))
    letters = cv2.FONT_HERSHEY_SIMPLEX, 0.8 * size, WHITE
    cv2.putText(canvas, sentence, where, *letters, width, cv2.LINE_AA)
    return canvas


def _closed(canvas: Picture, pixels: Array, colour: tuple[int, int, int]) -> None:
    if np.isfinite(pixels).all() and np.abs(pixels).max() < 1e5:
        points = np.rint(pixels * (1 << FRACTION_BITS)).astype(np.int32)
        with contextlib.suppress(cv2.error):
            cv2.polylines(canvas, [points], True, colour, 2, cv2.LINE_AA, FRACTION_BITS)
