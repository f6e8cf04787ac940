"""The simulated camera: edges are at their true places, and each flaw has its stated effect."""

from dataclasses import replace

import numpy as np
import pytest
from cameras import SIZE, camera, stain

from drivers.sim.camera.cards import lying
from drivers.sim.camera.optics import webcam
from drivers.sim.camera.render import BEHIND_TONE, Flaws, render

CLEAN = Flaws(blur_px=0.0, noise=0.0, gain=0.9, gradient=0.0, jpeg_quality=None)
STRAIGHT = webcam((0.0, 0.0, -300.0), size=SIZE)
WHITE = np.ones((2, 2), np.uint8)


def square(x=0.0):
    """A white card of 30 mm."""
    return lying(WHITE, 15.0, (x, 0.0, 0.0), face_down=True, margin_mm=0.0)


def taken(cards, flaws=CLEAN):
    return render(STRAIGHT, cards, flaws, np.random.default_rng(0)).astype(float)


def test_optics_project_returns_corner_rays_to_their_pixels():
    optics = camera()
    rays = optics.corner_rays[::60, ::60].reshape(-1, 3)
    back = optics.project(optics.eye_mm + 250.0 * rays)
    x, y = np.meshgrid(np.arange(0, 961, 60) - 0.5, np.arange(0, 541, 60) - 0.5)
    assert np.abs(back - np.column_stack([x.ravel(), y.ravel()])).max() < 1e-7


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.31])
def test_render_edge_pixel_brightness_is_covered_share(shift):
    # The levels of a row add up to the card's width in pixels, wherever within a pixel the card begins.
    card = square(shift)
    levels = taken([card])
    behind, bright = np.rint(255 * 0.9 * np.array([BEHIND_TONE, 0.88]))
    row = levels[round(STRAIGHT.project(np.zeros((1, 3)))[0, 1])]
    covered = np.sum((row - behind) / (bright - behind))
    ends = STRAIGHT.project(np.array([[-15.0 + shift, 0.0, 0.0], [15.0 + shift, 0.0, 0.0]]))
    assert abs(covered - (ends[1, 0] - ends[0, 0])) < 0.3


def test_render_blur_spreads_edge_and_keeps_light():
    sharp, soft = taken([square()]), taken([square()], replace(CLEAN, blur_px=2.0))
    assert abs(sharp.sum() - soft.sum()) < 1e-3 * sharp.sum()
    assert np.abs(np.diff(soft, axis=1)).max() < 0.4 * np.abs(np.diff(sharp, axis=1)).max()


def test_render_motion_smears_only_along_its_direction():
    def smeared(axis, speed):
        moving = replace(square(), speed_mm=np.array([*speed, 0.0]))
        return np.abs(np.diff(taken([moving]), axis=axis)).max()

    still = smeared(1, (0.0, 0.0))
    assert smeared(1, (3.0, 0.0)) < 0.6 * still
    assert smeared(1, (0.0, 3.0)) > 0.9 * still


def test_render_card_hides_card_below_it():
    half = stain((20.0, 0.0, 0.0), (40.0, 80.0))
    open_, covered = taken([square()]), taken([square(), half])
    places = np.array([[-8.0, 0.0, 0.0], [8.0, 0.0, 0.0]])
    left, right = STRAIGHT.project(places).round().astype(int)
    assert covered[left[1], left[0]] == open_[left[1], left[0]]
    assert covered[right[1], right[0]] < 0.5 * open_[right[1], right[0]]
