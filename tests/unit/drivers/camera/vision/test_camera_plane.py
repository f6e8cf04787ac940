"""Pixels to millimetres and back, against formulas and the simulated optics, from above and below."""

import numpy as np
import pytest
from cameras import RECTANGLE, camera, true_view
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.vision.lens import Lens
from drivers.camera.vision.plane import as_it_lies, rigid_fit
from drivers.planar import compose

LENS = Lens(1920, 1080, (1105.0, 1090.0), (950.0, 548.0), (0.10, -0.19, 0.0006, -0.0004, 0.06))
POSES = st.tuples(st.floats(-300, 300), st.floats(-300, 300), st.floats(-3.1, 3.1))


def grid(width=1920, height=1080, count=13):
    x, y = np.meshgrid(np.linspace(0, width - 1, count), np.linspace(0, height - 1, count))
    return np.column_stack([x.ravel(), y.ravel()])


def test_lens_pixels_follow_brown_conrady_formula():
    rays = np.random.default_rng(1).uniform(-0.8, 0.8, (200, 2))
    (k1, k2, p1, p2, k3), (x, y) = LENS.distortion, rays.T
    r2 = x**2 + y**2
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2)
    v = y * radial + p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y
    expected = np.column_stack([u, v]) * LENS.focal + LENS.centre
    assert np.abs(LENS.pixels(rays) - expected).max() < 1e-9


def test_lens_rays_invert_pixels_over_whole_picture():
    assert np.abs(LENS.pixels(LENS.rays(grid())) - grid()).max() < 1e-8


def test_lens_rays_of_unreachable_pixel_are_nan():
    barrel = Lens(1920, 1080, (1000.0, 1000.0), (960.0, 540.0), (-0.5, 0.0, 0.0, 0.0, 0.0))
    assert np.isnan(barrel.rays(np.array([[9000.0, 540.0]]))).all()
    assert np.isfinite(barrel.rays(np.array([[960.0, 540.0]]))).all()


@pytest.mark.parametrize("below", [True, False])
def test_view_pixels_at_inverts_on_plane(below):
    view = true_view(camera(below=below))
    assert view.from_below is below
    pixels = grid(960, 540, 9)
    for height in (0.0, 7.5):
        places = view.on_plane(pixels, height)
        assert np.abs(view.pixels_at(places, height) - pixels).max() < 1e-7


@pytest.mark.parametrize("below", [True, False])
def test_view_pixels_equal_simulated_optics(below):
    optics = camera(below=below)
    points = np.random.default_rng(2).uniform(-80, 80, (50, 3)) * (1, 1, 0.1)
    assert np.abs(true_view(optics).pixels(points) - optics.project(points)).max() < 1e-9


def test_view_ray_missing_plane_is_nan():
    view = true_view(camera(below=True))
    assert np.isnan(view.on_plane(np.array([[480.0, 270.0]]), height_mm=-1000.0)).all()
    assert np.isnan(view.pixels(np.array([[0.0, 0.0, -1000.0]]))).all()


@given(POSES)
def test_rigid_fit_recovers_motion(pose):
    moved = np.array([compose(pose, (*corner, 0.0))[:2] for corner in RECTANGLE])
    fit = rigid_fit(RECTANGLE, moved)
    assert np.abs(np.subtract(fit.pose[:2], pose[:2])).max() < 1e-9
    assert abs(np.remainder(fit.pose[2] - pose[2] + np.pi, 2 * np.pi) - np.pi) < 1e-12
    assert fit.rms_mm < 1e-9
    assert abs(fit.scale - 1.0) < 1e-12


def test_as_it_lies_keeps_y_axis_only_from_below():
    print_mm = np.array([[1.0, 2.0]])
    assert as_it_lies(print_mm, True).tolist() == [[1.0, 2.0]]
    assert as_it_lies(print_mm, False).tolist() == [[1.0, -2.0]]
