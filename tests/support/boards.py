"""Simulates a calibration board before the camera of `cameras`.

The board is a card, which can be rendered. The corners in a picture of the card are computed without
rendering.
"""

import cv2
import numpy as np
from cameras import SIZE, camera, true_view

from drivers.camera.vision.board import BoardView
from drivers.sim.camera.cards import Card, board_cells, lying

OPTICS = camera()
VIEW = true_view(OPTICS)
ON_TABLE = (10.0, -6.0, 0.2)
TILTS = [(a, b) for a in (-0.5, 0.0, 0.5) for b in (-0.5, 0.0, 0.5)]


def held(tilt, spot, distance_mm):
    """Returns the board as a card that is held before the camera and tilted.

    Args:
        tilt: rotation about the camera's x and y axes [rad].
        spot: pixel at which the board's middle appears.
        distance_mm: depth of the board's middle along the camera's axis.
    """
    ray = VIEW.lens.rays(np.array([spot]))[0]
    turn, _ = cv2.Rodrigues(np.array([*tilt, 0.1]))
    middle = distance_mm * np.array([*ray, 1.0])
    back = OPTICS.rotation.T
    right, down = (back @ turn[:, k] for k in (0, 1))
    return Card(board_cells(12, 9), 14.0 / 8, 8.0, OPTICS.eye_mm + back @ middle, right, down)


def corners_on_board():
    x, y = np.meshgrid(np.arange(1, 12), np.arange(1, 9))
    return (np.column_stack([x.ravel(), y.ravel()]) - (6.0, 4.5)) * 14.0


def seen(card, name, rng=None, noise_px=0.0):
    """Returns the board's corners in a picture of the card, as a perfect detector would find them.

    `name` is the name of the picture. `rng` adds noise with the standard deviation `noise_px`.
    """
    points = corners_on_board()
    solid = card.centre_mm + points[:, :1] * card.right + points[:, 1:] * card.down
    pixels = OPTICS.project(solid)
    if noise_px:
        pixels = pixels + rng.normal(0.0, noise_px, pixels.shape)
    inside = ((pixels > 3) & (pixels < np.array(SIZE) - 4)).all(axis=1)
    return BoardView(name, points[inside], pixels[inside])


def cards():
    """Returns cards of the board: one flat on the table, the others tilted, in all parts of the picture."""
    table = lying(board_cells(12, 9), 14.0 / 8, ON_TABLE, face_down=True, margin_mm=8.0)
    spots = [(200, 150), (760, 150), (200, 390), (760, 390), (480, 270)]
    shown = (held(tilt, spots[k % 5], 190.0 + 12.0 * (k % 4)) for k, tilt in enumerate(TILTS))
    return [table, *shown]


def places():
    """Returns points (n, 2) of the table [mm], spread over the whole picture, and their pixels (n, 2)."""
    x, y = np.meshgrid(np.linspace(30, 930, 9), np.linspace(30, 510, 5))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    return VIEW.on_plane(pixels), pixels
