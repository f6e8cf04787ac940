"""Printed cards for the simulated camera: a grid of black and white squares in space."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.planar import Pose2
from drivers.sim.camera.optics import Array

Cells = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """A printed rectangle of black and white squares with a white margin, at a pose in space."""

    cells: Cells  # (rows, columns) 1 = white, as printed
    cell_mm: float  # edge of a square
    margin_mm: float  # white border around the squares
    centre_mm: Array  # (3,) middle of the grid in the world
    right: Array  # (3,) unit vector along which the card's rows run
    down: Array  # (3,) unit vector along which the card's columns run
    # (3,) motion during the exposure
    speed_mm: Array = field(default_factory=lambda: np.zeros(3))
    tones: tuple[float, float] = (0.08, 0.88)  # reflectance of black and of white, 0 to 1

    @property
    def half_mm(self) -> Array:
        """Half the width (along `right`) and half the height (along `down`) of the card with margin, mm."""
        rows, columns = self.cells.shape
        return 0.5 * self.cell_mm * np.array([columns, rows]) + self.margin_mm


def lying(
    cells: Cells, cell_mm: float, pose: Pose2, *, face_down: bool, margin_mm: float | None = None
) -> Card:
    """Creates a card that lies flat on the table.

    `pose` has the place of the card's middle and the angle of its rows, in the world (mm, mm, rad). A card
    that lies face down is read from below. The default margin is one square wide.
    """
    x, y, theta = pose
    c, s = np.cos(theta), np.sin(theta)
    down = np.array([-s, c, 0.0]) if face_down else np.array([s, -c, 0.0])
    margin_mm = cell_mm if margin_mm is None else margin_mm
    centre, right = np.array([x, y, 0.0]), np.array([c, s, 0.0])
    return Card(cells, cell_mm, margin_mm, centre, right, down)


def tag_cells(number: int) -> Cells:
    """The squares of a tag of the family 36h11 with its black border: (8, 8), 1 = white."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, number, 8) > 127, np.uint8)


def board_cells(columns: int, rows: int) -> Cells:
    """The cells of a ChArUco board of `rows` x `columns` fields: (8 * rows, 8 * columns), 1 = white.

    A field is 8 x 8 cells; the marker in every second field is 6 x 6 cells (DICT_4X4_250).
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
    board = cv2.aruco.CharucoBoard((columns, rows), 8.0, 6.0, dictionary)
    drawn = board.generateImage((8 * columns, 8 * rows), marginSize=0, borderBits=1)
    return np.asarray(drawn > 127, np.uint8)
