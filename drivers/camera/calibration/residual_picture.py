"""Picture of the residuals over the work area: an SVG for any browser."""

import html
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from drivers.camera.calibration.file import Trust
from drivers.camera.calibration.fit import Fitted
from drivers.camera.calibration.table_fit import Residuals

# Okabe and Ito's blue and vermilion; greys.
BLUE, RED, GREY = "#0072B2", "#D55E00", "#a6a6a6"
WIDTH, MARGIN, COVERAGE_WIDTH = 960.0, 46.0, 240.0
SVG = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="14"'
ARROW = 200.0  # magnification of residuals
BANDS_MM = (0.05, 0.1, 0.2, 0.5)
SHADES = ("#eef5fb", "#d3e5f3", "#a9cbe6", "#f6d3b8", "#efa97f")


def draw(fitted: Fitted) -> str:
    """Returns the SVG: residuals and standard deviations on the table, and where the board was seen."""
    trust, lens = fitted.calibration.trust, fitted.calibration.view.lens
    (left, right), (bottom, top) = ((axis[0], axis[-1]) for axis in (trust.x_mm, trust.y_mm))
    scale = (WIDTH - 2 * MARGIN) / (right - left)
    height = (top - bottom) * scale + 2 * MARGIN
    # Place of the table's middle in the picture.
    x, y = MARGIN - left * scale, height - MARGIN + bottom * scale
    small = COVERAGE_WIDTH / lens.width
    total = height + lens.height * small + 60.0
    below, beside = height - MARGIN + 18, MARGIN - 6
    across = (_text(x + mm * scale, below, str(mm), "middle") for mm in _ticks(left, right))
    along = (_text(beside, y - mm * scale + 5, str(mm), "end") for mm in _ticks(bottom, top))
    lines = enumerate(_words(fitted))
    words = (_text(MARGIN + 270, height + 40 + 22 * k, line) for k, line in lines)
    dots = "".join(f"M{u:.0f} {v:.0f}h1" for view in fitted.views for u, v in view.pixels)
    return f"""\
<svg {SVG} viewBox="0 0 {WIDTH:.0f} {total:.0f}">
<rect width="{WIDTH:.0f}" height="{total:.0f}" fill="white"/>
<g transform="translate({x:.1f} {y:.1f}) scale({scale:.4f} {-scale:.4f})">
{"".join(_shades(trust))}
<g stroke="{RED}" stroke-width="{1.0 / scale:.4f}">{"".join(_arrows(fitted.residuals, 1.5 / scale))}</g>
<path d="M{left:.1f} {bottom:.1f}H{right:.1f}V{top:.1f}H{left:.1f}z" fill="none" stroke="{GREY}"
 stroke-width="{1.0 / scale:.4f}"/>
</g>
{"".join((*across, *along))}
<g transform="translate({MARGIN:.0f} {height + 20.0:.1f}) scale({small:.4f})">
<rect width="{lens.width}" height="{lens.height}" fill="#f7f7f7" stroke="{GREY}" stroke-width="4"/>
<path d="{dots}" stroke="{BLUE}" stroke-width="9" stroke-linecap="round" opacity=".5"/>
</g>
{"".join(words)}
</svg>
"""


def _shades(trust: Trust) -> Iterator[str]:
    for i, (low, high) in enumerate(pairwise(trust.y_mm)):
        for j, (left, right) in enumerate(pairwise(trust.x_mm)):
            sigma = float(trust.sigma_mm[i : i + 2, j : j + 2].mean())
            shade = SHADES[int(np.searchsorted(BANDS_MM, sigma))]
            yield (
                f'<path d="M{left:.1f} {low:.1f}H{right:.1f}V{high:.1f}H{left:.1f}z" fill="{shade}" '
                f'shape-rendering="crispEdges"><title>{sigma:.3f} mm</title></path>'
            )


def _arrows(residuals: Residuals, radius: float) -> Iterator[str]:
    for (x, y), (dx, dy) in zip(residuals.places, residuals.off, strict=True):
        yield f'<path d="M{x:.2f} {y:.2f}l{dx * ARROW:.2f} {dy * ARROW:.2f}"/>'
        yield f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius:.3f}" fill="{RED}"/>'


def _ticks(low: float, high: float) -> range:
    return range(100 * int(np.ceil(low / 100)), int(high) + 1, 100)


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(words)}</text>'


def _words(fitted: Fitted) -> tuple[str, ...]:
    known, residuals = fitted.calibration, fitted.residuals
    bands = ", ".join(f"{band:g}" for band in BANDS_MM)
    largest = f"{np.hypot(*residuals.off.T).max():.3f} mm largest (red, {ARROW:g} times as long)"
    return (
        f"camera {known.camera}, calibrated {known.date}",
        f"{known.views} views of the board, residual {known.rms_px:.3f} px",
        f"boards on the table: {residuals.rms_mm:.3f} mm rms, {largest}",
        f"alignment with the arm: {known.alignment_mm:.3f} mm rms",
        f"shades: standard deviation of a place, steps at {bands} mm",
        "small picture: corners of all views in the camera's picture",
    )
