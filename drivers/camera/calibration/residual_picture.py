"""Residuals over the work area as a picture: an SVG to be opened in any browser."""

import html
from collections.abc import Iterator, Sequence

import numpy as np

from drivers.camera.calibration.file import CameraCalibration
from drivers.camera.calibration.table_fit import Residuals
from drivers.camera.vision.arrays import Array

# Okabe and Ito's blue and vermilion; greys.
BLUE, RED, GREY = "#0072B2", "#D55E00", "#a6a6a6"
WIDTH = 960.0
MARGIN = 46.0
SVG = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="14"'
ARROW = 200.0  # times as long as the residual
BANDS_MM = (0.05, 0.1, 0.2, 0.5)
SHADES = ("#eef5fb", "#d3e5f3", "#a9cbe6", "#f6d3b8", "#efa97f")


def draw(calibration: CameraCalibration, residuals: Residuals, boards: Sequence[Array]) -> str:
    """The picture.

    Args:
        calibration: of the camera.
        residuals: of boards on the table, in the arm's world.
        boards: corners (n, 2) in pixels of every view, for what of the picture they cover.
    """
    trust = calibration.trust
    low = np.array([trust.x_mm[0], trust.y_mm[0]])
    span = np.array([trust.x_mm[-1], trust.y_mm[-1]]) - low
    scale = (WIDTH - 2 * MARGIN) / float(span[0])
    height = float(span[1]) * scale + 2 * MARGIN
    lens = calibration.view.lens
    small = 240.0 / lens.width
    total = height + lens.height * small + 60.0
    return "\n".join(
        [
            f'<svg {SVG} viewBox="0 0 {WIDTH:.0f} {total:.0f}">',
            f'<rect width="{WIDTH:.0f}" height="{total:.0f}" fill="white"/>',
            *_shades(calibration, low, scale, height),
            *_arrows(residuals, low, scale, height),
            *_axes(low, span, scale, height),
            *_coverage(boards, lens.width, lens.height, small, height + 20.0),
            *_words(calibration, residuals, height + 40.0),
            "</svg>",
            "",
        ]
    )


def _shades(calibration: CameraCalibration, low: Array, scale: float, height: float) -> Iterator[str]:
    trust = calibration.trust
    for i in range(len(trust.y_mm) - 1):
        for j in range(len(trust.x_mm) - 1):
            sigma = float(trust.sigma_mm[i : i + 2, j : j + 2].mean())
            shade = SHADES[int(np.searchsorted(BANDS_MM, sigma))]
            x = MARGIN + (trust.x_mm[j] - low[0]) * scale
            y = height - MARGIN - (trust.y_mm[i + 1] - low[1]) * scale
            wide = (trust.x_mm[j + 1] - trust.x_mm[j]) * scale
            high = (trust.y_mm[i + 1] - trust.y_mm[i]) * scale
            yield (
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide + 0.5:.1f}" height="{high + 0.5:.1f}" '
                f'fill="{shade}"><title>{sigma:.3f} mm</title></rect>'
            )


def _arrows(residuals: Residuals, low: Array, scale: float, height: float) -> Iterator[str]:
    for (x, y), (dx, dy) in zip(residuals.places, residuals.off, strict=True):
        u, v = MARGIN + (x - low[0]) * scale, height - MARGIN - (y - low[1]) * scale
        yield (
            f'<path d="M{u:.1f} {v:.1f}l{dx * scale * ARROW:.1f} {-dy * scale * ARROW:.1f}" stroke="{RED}"/>'
            f'<circle cx="{u:.1f}" cy="{v:.1f}" r="1.5" fill="{RED}"/>'
        )


def _axes(low: Array, span: Array, scale: float, height: float) -> Iterator[str]:
    left, right = MARGIN, MARGIN + span[0] * scale
    bottom, top = height - MARGIN, height - MARGIN - span[1] * scale
    yield (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
        f'fill="none" stroke="{GREY}"/>'
    )
    for x in range(100 * int(np.ceil(low[0] / 100)), int(low[0] + span[0]) + 1, 100):
        yield _text(left + (x - low[0]) * scale, bottom + 18, str(x), "middle")
    for y in range(100 * int(np.ceil(low[1] / 100)), int(low[1] + span[1]) + 1, 100):
        yield _text(left - 6, bottom - (y - low[1]) * scale + 5, str(y), "end")


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(words)}</text>'


def _coverage(boards: Sequence[Array], width: int, height: int, small: float, top: float) -> Iterator[str]:
    yield (
        f'<g transform="translate({MARGIN:.0f} {top:.1f}) scale({small:.4f})">'
        f'<rect width="{width}" height="{height}" fill="#f7f7f7" stroke="{GREY}" stroke-width="4"/>'
    )
    for corners in boards:
        dots = "".join(f"M{x:.0f} {y:.0f}h1" for x, y in corners)
        yield f'<path d="{dots}" stroke="{BLUE}" stroke-width="9" stroke-linecap="round" opacity=".5"/>'
    yield "</g>"


def _words(calibration: CameraCalibration, residuals: Residuals, top: float) -> Iterator[str]:
    off = np.hypot(*residuals.off.T)
    bands = ", ".join(f"{band:g}" for band in BANDS_MM)
    scale = f"red, {ARROW:g} times as long"
    lines = (
        f"camera {calibration.camera}, calibrated {calibration.made}",
        f"{calibration.views} views of the board, residual {calibration.rms_px:.3f} px",
        f"boards on the table: {residuals.rms_mm:.3f} mm rms, {off.max():.3f} mm largest ({scale})",
        f"alignment with the arm: {calibration.alignment_mm:.3f} mm rms",
        f"shades: standard deviation of a place, steps at {bands} mm",
        "small picture: corners of all views in the camera's picture",
    )
    for number, line in enumerate(lines):
        yield _text(MARGIN + 270, top + 22 * number, line)
