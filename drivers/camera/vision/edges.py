"""Refines the corners of a tag to a few hundredths of a pixel: they are intersections of its edge lines.

Profiles of grey levels are read across each side. The edge in a profile is the centroid of the slope within a
window. The window is centred on the edge, so that blur does not move the result. A line is fitted to the
edges of each side, without outliers (a stain, a finger's shadow).
"""

from typing import NamedTuple

import numpy as np

from drivers.camera.vision.arrays import Array, Mask, Picture

PROFILES = 28  # number of profiles along a side
INSET = 0.10  # share of a side, left out at each end, where profiles meet the next side
STEP_PX = 0.25  # distance of samples along a profile
REACH_SQUARES = 0.95  # length of a profile to either side of the edge, in squares
WINDOW_SQUARES = 0.55
ROUNDS = 3
RECENTRINGS = 3
LEAST_CONTRAST = 12.0  # least difference of black and white, grey levels
OUTLIER_PX = 0.25
LEAST_SHARE = 0.5  # least share of the profiles of a side that show an edge


class Corners(NamedTuple):
    """Refined corners of a tag, and how well lines fit its edges."""

    pixels: Array  # (4, 2) in the order of the input
    rms_px: float  # rms distance of the edge points from their lines


def refine(picture: Picture, corners: Array, squares: int) -> Corners | None:
    """Refines the corners of a tag's black border; returns None if an edge is not seen well enough.

    Args:
        picture: (h, w) grey levels.
        corners: (4, 2) pixels, accurate to about two pixels, in order around the tag.
        squares: number of squares along a side, including the border: 8 for 36h11.
    """
    corners = np.asarray(corners, np.float64)
    for _ in range(ROUNDS):
        result = _refined(picture, corners, squares)
        if result is None:
            return None
        corners = result.pixels
    return result


def _refined(picture: Picture, corners: Array, squares: int) -> Corners | None:
    ends = np.roll(corners, -1, axis=0)
    lengths = np.hypot(*(ends - corners).T)
    if lengths.min() < 2.0 * squares:
        return None
    along = (ends - corners) / lengths[:, None]
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    outwards = np.sign(np.sum(across * (corners - corners.mean(axis=0)), axis=1))
    across *= outwards[:, None]
    square = float(lengths.mean()) / squares
    offsets = np.arange(-REACH_SQUARES * square, REACH_SQUARES * square + 0.5 * STEP_PX, STEP_PX)
    shares = np.linspace(INSET, 1.0 - INSET, PROFILES)
    places = corners[:, None] + shares[None, :, None] * (ends - corners)[:, None]  # (4, m, 2)
    spots = places[:, :, None] + offsets[None, None, :, None] * across[:, None, None]
    levels = _sample(picture, spots)
    if levels is None:
        return None
    edge, sharp = _edges(levels, offsets, WINDOW_SQUARES * square)
    lines = [_line(shares * n, e, ok) for n, e, ok in zip(lengths, edge, sharp, strict=True)]
    entries = [line for line in lines if line is not None]
    if len(entries) < len(lines):
        return None
    offset, slope, rms = np.array(entries).T
    origins, headings = corners + offset[:, None] * across, along + slope[:, None] * across
    return Corners(_crossings(origins, headings), float(np.sqrt(np.mean(rms**2))))


def _sample(picture: Picture, spots: Array) -> Array | None:
    """Interpolates the grey levels at places (..., 2), x and y in pixels, bilinearly.

    Returns None if a place is outside the picture.
    """
    x, y = spots[..., 0], spots[..., 1]
    height, width = picture.shape
    if not (x.min() >= 0 and y.min() >= 0 and x.max() < width - 1 and y.max() < height - 1):
        return None
    column, row = x.astype(np.intp), y.astype(np.intp)
    u, v = x - column, y - row
    upper = (1.0 - u) * picture[row, column] + u * picture[row, column + 1]
    lower = (1.0 - u) * picture[row + 1, column] + u * picture[row + 1, column + 1]
    return np.asarray((1.0 - v) * upper + v * lower)


def _edges(levels: Array, offsets: Array, window: float) -> tuple[Array, Mask]:
    """Locates the edge in each profile of grey levels across a side.

    Args:
        levels: (..., k) grey levels.
        offsets: (k,) places along a profile, px.
        window: half the width of the window around the edge, px.

    Returns:
        (...) offsets of the edges, px, and whether the contrast suffices for an edge.
    """
    slope = np.clip(np.diff(levels, axis=-1), 0.0, None)
    middles = 0.5 * (offsets[1:] + offsets[:-1])
    near = np.abs(middles) <= window
    steep = slope[..., near]
    smooth = steep + np.roll(steep, 1, axis=-1) + np.roll(steep, -1, axis=-1)
    centre = middles[near][np.argmax(smooth, axis=-1)]
    for _ in range(RECENTRINGS):
        # The window's ends fade out, so that the centroid moves smoothly with it.
        left = window - np.abs(middles - centre[..., None])
        weight = slope * np.clip(left / STEP_PX + 0.5, 0.0, 1.0)
        total, moment = weight.sum(axis=-1), (weight * middles).sum(axis=-1)
        centre = np.where(total > 0.0, moment / np.maximum(total, 1e-9), 0.0)
    return centre, np.asarray(total >= LEAST_CONTRAST)


def _line(along: Array, edge: Array, sharp: Mask) -> tuple[float, float, float] | None:
    """Fits a line to the edge points of a side, leaving out outliers.

    Args:
        along: (m,) places of the profiles along the side, px.
        edge: (m,) offset of the edge in each profile, px.
        sharp: (m,) whether the profile shows an edge.

    Returns:
        Offset, slope and rms residual; None if too few points remain.
    """
    kept = sharp.copy()
    for _ in range(4):
        if kept.sum() < LEAST_SHARE * len(edge):
            return None
        slope, offset = np.polyfit(along[kept], edge[kept], 1)
        left = np.abs(edge - offset - slope * along)
        limit = max(OUTLIER_PX, 2.5 * 1.4826 * float(np.median(left[sharp])))
        kept = np.asarray(sharp & (left <= limit), np.bool_)
    if kept.sum() < LEAST_SHARE * len(edge):
        return None
    return float(offset), float(slope), float(np.sqrt(np.mean(left[kept] ** 2)))


def _crossings(origins: Array, headings: Array) -> Array:
    """Intersects each side's line with the line of the side before; returns the corners, (4, 2)."""
    before, turned = np.roll(origins, 1, axis=0), np.roll(headings, 1, axis=0)
    gap = before - origins
    bend = headings[:, 0] * turned[:, 1] - headings[:, 1] * turned[:, 0]
    reach = (gap[:, 0] * turned[:, 1] - gap[:, 1] * turned[:, 0]) / bend
    return np.asarray(origins + reach[:, None] * headings)
