"""Rendering: intersects many rays through each pixel with the cards, then adds a real picture's flaws.

A pixel is the mean over `SAMPLES` x `SAMPLES` rays spread evenly over its square, just as a pixel of a sensor
averages the light on its area. So an edge is accurate to about a hundredth of a pixel: larger errors of a
measured edge come from the measurement.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.sim.camera.cards import Card
from drivers.sim.camera.optics import Array, Optics

Picture = NDArray[np.uint8]
Levels = NDArray[np.float32]

SAMPLES = 4
BEHIND_TONE = 0.45  # reflectance, 0 to 1, where there is no card
# Moment of the exposure of each sample: any order without a spatial pattern will do.
MOMENTS = np.random.default_rng(36).permutation(SAMPLES * SAMPLES)


@dataclass(frozen=True, slots=True)
class Flaws:
    """Blur, noise, exposure, uneven light and compression that are added to a rendered picture."""

    blur_px: float = 0.7  # standard deviation of the lens's blur
    noise: float = 2.5  # standard deviation of the sensor's noise, grey levels of 255
    gain: float = 0.9  # grey level of a perfect white, as a share of 255
    # Falloff of the light from the upper left to the lower right, as a share
    gradient: float = 0.2
    jpeg_quality: int | None = 90  # 1 to 100; None: not compressed


def render(
    optics: Optics, cards: Sequence[Card], flaws: Flaws, rng: np.random.Generator
) -> Picture:
    """Renders a picture.

    Args:
        optics: the camera.
        cards: the visible cards; a later one covers an earlier one.
        flaws: flaws of lens, light, sensor and compression.
        rng: draws the noise.

    Returns:
        (height, width) grey levels.
    """
    levels = np.full((optics.height, optics.width), BEHIND_TONE, np.float32)
    for card in cards:
        _draw(levels, optics, card)
    levels *= _light(optics, flaws)
    if flaws.blur_px > 0.0:
        levels = np.asarray(cv2.GaussianBlur(levels, (0, 0), flaws.blur_px), np.float32)
    if flaws.noise > 0.0:
        levels += np.float32(flaws.noise) * rng.standard_normal(levels.shape, np.float32)
    picture = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return picture if flaws.jpeg_quality is None else compressed(picture, flaws.jpeg_quality)


def compressed(picture: Picture, quality: int) -> Picture:
    """Returns the picture after JPEG compression."""
    decoded = cv2.imdecode(np.frombuffer(jpeg(picture, quality), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert decoded is not None
    return np.asarray(decoded, np.uint8)


def jpeg(picture: Picture, quality: int) -> bytes:
    """Returns the bytes of the picture as a JPEG file."""
    _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return bytes(coded.tobytes())


def _light(optics: Optics, flaws: Flaws) -> Levels:
    across = np.linspace(0.5, -0.5, optics.width, dtype=np.float32)
    down = np.linspace(0.5, -0.5, optics.height, dtype=np.float32)
    slope = 1.0 + 0.5 * flaws.gradient * (across[None, :] + down[:, None])
    return np.asarray(255.0 * flaws.gain * slope, np.float32)


def _draw(levels: Levels, optics: Optics, card: Card) -> None:
    """Draws a card over the picture `levels`, in place."""
    box = _box(optics, _outline(card))
    if box is None:
        return
    rows, columns = box
    behind = levels[rows, columns]
    total = np.zeros(behind.shape, np.float32)
    axes = np.stack([card.right, card.down, np.cross(card.right, card.down)], axis=1)
    for moment, (along, across, away) in _rays(optics, box, axes):
        eye = (optics.eye_mm - card.centre_mm - (moment - 0.5) * card.speed_mm) @ axes
        reach = np.float32(-eye[2]) / away
        x, y = reach * along + np.float32(eye[0]), reach * across + np.float32(eye[1])
        total += _tone(card, x, y, behind)
    behind[:] = total / (SAMPLES * SAMPLES)


def _tone(card: Card, along: Levels, across: Levels, behind: Levels) -> Levels:
    """Returns the tones of a card at points (along, across) [mm] of its plane; `behind` outside the card."""
    rows, columns = card.cells.shape
    column = np.clip(np.floor(along / card.cell_mm + 0.5 * columns), -1, columns).astype(np.intp)
    row = np.clip(np.floor(across / card.cell_mm + 0.5 * rows), -1, rows).astype(np.intp)
    half_along, half_across = card.half_mm
    on_card = (np.abs(along) <= half_along) & (np.abs(across) <= half_across)
    with_margin = np.pad(card.cells, 1, constant_values=1)
    tones = np.array(card.tones, np.float32)[with_margin]
    return np.where(on_card, tones[row + 1, column + 1], behind)


def _outline(card: Card) -> Array:
    """Points on the rim of a card at the start and end of the exposure, (n, 3) mm."""
    half_along, half_across = card.half_mm
    rim = np.concatenate([[(t, -1), (t, 1), (-1, t), (1, t)] for t in np.linspace(-1.0, 1.0, 9)])
    way = rim[:, :1] * half_along * card.right + rim[:, 1:] * half_across * card.down
    points, half = card.centre_mm + way, 0.5 * card.speed_mm
    return np.concatenate([points - half, points + half])


def _box(optics: Optics, points_mm: Array) -> tuple[slice, slice] | None:
    """Rows and columns of the picture that contain all these points; None if they lie outside the picture."""
    seen = optics.project(points_mm)
    left, top = np.floor(seen.min(axis=0)).astype(int) - 2
    right, bottom = np.ceil(seen.max(axis=0)).astype(int) + 3
    top, bottom = max(top, 0), min(bottom, optics.height)
    left, right = max(left, 0), min(right, optics.width)
    return (slice(top, bottom), slice(left, right)) if top < bottom and left < right else None


def _rays(optics: Optics, box: tuple[slice, slice], axes: Array) -> Iterator[tuple[float, Levels]]:
    """Yields, for each sample of a pixel, one ray through every pixel of a box.

    Args:
        optics: the camera.
        box: rows and columns of the pixels.
        axes: (3, 3) basis of the ray directions, one axis a column.

    Yields:
        Moment of the sample as a share of the exposure, and ray directions, (3, height, width).
    """
    rows, columns = box
    grid = optics.corner_rays[rows.start : rows.stop + 1, columns.start : columns.stop + 1] @ axes
    corners = np.ascontiguousarray(np.moveaxis(grid, -1, 0), np.float32)
    steps = (np.arange(SAMPLES, dtype=np.float32) + np.float32(0.5)) / np.float32(SAMPLES)
    for column, u in enumerate(steps):
        edges = corners[..., :-1] + u * np.diff(corners, axis=2)
        for row, v in enumerate(steps):
            moment = (MOMENTS[row * SAMPLES + column] + 0.5) / (SAMPLES * SAMPLES)
            yield float(moment), edges[:, :-1] + v * np.diff(edges, axis=1)
