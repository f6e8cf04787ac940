"""The picture itself: rays cut with cards, many to a pixel, then everything that spoils a real picture.

A pixel is the mean over `SAMPLES` x `SAMPLES` rays spread evenly over its square, as a sensor's is over
its light: an edge is where it should be to about a hundredth of a pixel, and what a measurement gets wrong is
its own.
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
BEHIND_TONE = 0.45
# In which of the moments of an exposure each sample is taken: any order without a pattern in space does.
MOMENTS = np.random.default_rng(36).permutation(SAMPLES * SAMPLES)


@dataclass(frozen=True, slots=True)
class Flaws:
    """What spoils a picture."""

    blur_px: float = 0.7  # standard deviation of the lens's blur
    noise: float = 2.5  # standard deviation of the sensor's noise, grey levels of 255
    gain: float = 0.9  # grey level of a perfect white, as a share of 255
    gradient: float = 0.2  # by how much light falls off from the upper left to the lower right, as a share
    jpeg_quality: int | None = 90  # 1 to 100; None: not compressed


def render(optics: Optics, cards: Sequence[Card], flaws: Flaws, rng: np.random.Generator) -> Picture:
    """Take a picture.

    Args:
        optics: the camera.
        cards: what lies before it; a later one covers an earlier one.
        flaws: of lens, light, sensor and compression.
        rng: of the noise.

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
    """The picture as it comes out of a JPEG file."""
    decoded = cv2.imdecode(np.frombuffer(jpeg(picture, quality), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert decoded is not None
    return np.asarray(decoded, np.uint8)


def jpeg(picture: Picture, quality: int) -> bytes:
    """The picture as a JPEG file."""
    _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return bytes(coded.tobytes())


def _light(optics: Optics, flaws: Flaws) -> Levels:
    across = np.linspace(0.5, -0.5, optics.width, dtype=np.float32)
    down = np.linspace(0.5, -0.5, optics.height, dtype=np.float32)
    slope = 1.0 + 0.5 * flaws.gradient * (across[None, :] + down[:, None])
    return np.asarray(255.0 * flaws.gain * slope, np.float32)


def _draw(levels: Levels, optics: Optics, card: Card) -> None:
    """Lay a card over the picture, in place."""
    box = _box(optics, _outline(card))
    if box is None:
        return
    rows, columns = box
    behind = levels[rows, columns]
    total = np.zeros(behind.shape, np.float32)
    normal = np.cross(card.right, card.down)
    for moment, rays in _rays(optics, box):
        centre = card.centre_mm + (moment - 0.5) * card.speed_mm
        reach = ((centre - optics.eye_mm) @ normal) / (rays @ normal)
        spot = reach[..., None] * rays + (optics.eye_mm - centre)
        total += _tone(card, spot @ card.right, spot @ card.down, behind)
    behind[:] = total / (SAMPLES * SAMPLES)


def _tone(card: Card, along: Array, across: Array, behind: Levels) -> Levels:
    """What is seen at places of a card's plane: its squares, its margin, or what is behind it."""
    rows, columns = card.cells.shape
    column = np.floor(along / card.cell_mm + 0.5 * columns).astype(np.int64)
    row = np.floor(across / card.cell_mm + 0.5 * rows).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    white = np.ones(inside.shape, np.uint8)
    white[inside] = card.cells[row[inside], column[inside]]
    half_along, half_across = card.half_mm
    on_card = (np.abs(along) <= half_along) & (np.abs(across) <= half_across)
    black, bright = card.tones
    return np.where(on_card, np.where(white > 0, np.float32(bright), np.float32(black)), behind)


def _outline(card: Card) -> Array:
    """Points all around a card and along its way, (n, 3)."""
    half_along, half_across = card.half_mm
    rim = np.concatenate([[(t, -1), (t, 1), (-1, t), (1, t)] for t in np.linspace(-1.0, 1.0, 9)])
    points = card.centre_mm + rim[:, :1] * half_along * card.right + rim[:, 1:] * half_across * card.down
    return np.concatenate([points - 0.5 * card.speed_mm, points + 0.5 * card.speed_mm])


def _box(optics: Optics, points_mm: Array) -> tuple[slice, slice] | None:
    """Rows and columns of the picture that hold these points; None: outside of it."""
    seen = optics.project(points_mm)
    left, top = np.floor(seen.min(axis=0)).astype(int) - 2
    right, bottom = np.ceil(seen.max(axis=0)).astype(int) + 3
    top, bottom = max(top, 0), min(bottom, optics.height)
    left, right = max(left, 0), min(right, optics.width)
    return (slice(top, bottom), slice(left, right)) if top < bottom and left < right else None


def _rays(optics: Optics, box: tuple[slice, slice]) -> Iterator[tuple[float, Array]]:
    """For each sample: its moment of the exposure, 0 to 1, and the rays of all pixels of a box, (h, w, 3)."""
    rows, columns = box
    grid = optics.corner_rays[rows.start : rows.stop + 1, columns.start : columns.stop + 1]
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES
    for number, (v, u) in enumerate((v, u) for v in steps for u in steps):
        upper = (1.0 - u) * grid[:-1, :-1] + u * grid[:-1, 1:]
        lower = (1.0 - u) * grid[1:, :-1] + u * grid[1:, 1:]
        moment = (MOMENTS[number] + 0.5) / (SAMPLES * SAMPLES)
        yield float(moment), (1.0 - v) * upper + v * lower
