"""Boards for calibration: ChArUco boards and plain chessboards, and their corners in a picture."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from drivers.camera.vision.arrays import Array, Picture
from runtime.shell.errors import InputError

LEAST_CORNERS = 12  # least corners of a view
NOTHING = np.zeros(0), np.zeros((0, 2))
# Half the window for refining a corner, in fields; markers leave an eighth of a field free.
WINDOW_SQUARES = 0.11


class BoardView(NamedTuple):
    """Corners of a board that were found in one picture."""

    name: str  # name of the picture
    # (n, 2) corners on the board, mm from its middle, x right and y down as one reads it
    points: Array
    pixels: Array  # (n, 2) pixels at which the corners are seen


@dataclass(frozen=True, slots=True)
class Board:
    """A printed board."""

    columns: int  # fields across
    rows: int  # fields down
    field_mm: float  # edge of a field, as measured on the print
    marker_mm: float  # edge of a ChArUco marker (DICT_4X4_250); 0: a plain chessboard

    def find(self, picture: Picture, name: str) -> BoardView | None:
        """Finds the board in a picture named `name`; returns None if too little of the board is seen."""
        numbers, pixels = self._charuco(picture) if self.marker_mm else self._chessboard(picture)
        if len(numbers) < LEAST_CORNERS:
            return None
        across = self.columns - 1
        grid = np.stack([numbers % across, numbers // across], axis=1) + 1.0
        points = (grid - 0.5 * np.array([self.columns, self.rows])) * self.field_mm
        return BoardView(name, points, _refined(picture, pixels, points, self.field_mm))

    def _charuco(self, picture: Picture) -> tuple[Array, Array]:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.field_mm, self.marker_mm, dictionary)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(picture)
        if ids is None or corners is None:
            return NOTHING
        return np.ravel(ids).astype(np.float64), np.asarray(corners, np.float64).reshape(-1, 2)

    def _chessboard(self, picture: Picture) -> tuple[Array, Array]:
        inner = (self.columns - 1, self.rows - 1)
        good, corners = cv2.findChessboardCornersSB(picture, inner, flags=cv2.CALIB_CB_ACCURACY)
        if not good:
            return NOTHING
        return np.arange(float(inner[0] * inner[1])), np.asarray(corners, np.float64).reshape(-1, 2)


def parse(text: str) -> Board:
    """Parses a board as an option states it, such as `charuco:12x9:30:22.5`; raises InputError if invalid."""
    try:
        kind, size, *lengths = text.split(":")
        columns, rows = map(int, size.split("x"))
        field_mm, marker_mm = map(float, lengths if kind == "charuco" else [*lengths, "0"])
    except ValueError:
        kind = ""
    known = kind in ("charuco", "chessboard")
    if not (known and min(columns, rows) >= 4 and 0 <= marker_mm < field_mm):
        raise InputError(
            f"board {text!r}: write charuco:12x9:30:22.5 or chessboard:12x9:30 "
            "(fields across and down, mm of a field, mm of a marker)"
        )
    return Board(columns, rows, field_mm, marker_mm)


def _refined(picture: Picture, pixels: Array, points: Array, field_mm: float) -> Array:
    """Refines the corners of a board to a few hundredths of a pixel.

    The window searched about each corner is scaled to the fields' size in the picture, so that it leaves out
    the markers.
    """
    gaps = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    gaps[gaps > 1.01 * field_mm] = 0.0
    first, second = np.nonzero(gaps)
    if len(first) == 0:
        return pixels
    spacing = float(np.percentile(np.hypot(*(pixels[first] - pixels[second]).T), 10.0))
    half = int(np.clip(round(WINDOW_SQUARES * spacing), 2, 11))
    start = np.ascontiguousarray(pixels, np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    result = cv2.cornerSubPix(picture, start, (half, half), (-1, -1), criteria)
    return np.asarray(result, np.float64).reshape(-1, 2)
