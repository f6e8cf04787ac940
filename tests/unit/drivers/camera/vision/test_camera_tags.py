"""Tags are detected, read and measured to a few hundredths of a millimetre, up to the stated limits."""

from dataclasses import replace

import numpy as np
import pytest
from cameras import (
    NUMBER,
    SIDE_MM,
    angle_between,
    camera,
    part_tag,
    stain,
    true_calibration,
    true_view,
)

from drivers.camera.calibration import measure
from drivers.camera.vision.plane import placed
from drivers.camera.vision.tags import find
from drivers.errors import PictureError
from drivers.sim.camera.cards import lying, tag_cells
from drivers.sim.camera.render import Flaws, render

BELOW, ABOVE = camera(below=True), camera(below=False)
# What a picture may suffer and still be measured; the README of the audit states the same figures.
LIMITS = {
    "blur": {"blur_px": 1.5, "noise": 4.0},
    "noise": {"noise": 8.0},
    "compression": {"jpeg_quality": 50},
    "dark": {"gain": 0.25},
    "uneven light": {"gradient": 1.0},
}


def poses(count, seed):
    rng = np.random.default_rng(seed)
    return [tuple(rng.uniform((-150, -70, -np.pi), (150, 70, np.pi))) for _ in range(count)]


def picture_of(optics, pose, number=NUMBER, flaws=None, seed=0, speed_mm=(0.0, 0.0), before=()):
    card = lying(tag_cells(number), SIDE_MM / 8, pose, face_down=optics.eye_mm[2] < 0)
    card = replace(card, speed_mm=np.array([*speed_mm, 0.0]))
    return render(optics, [card, *before], flaws or Flaws(), np.random.default_rng(seed))


def errors(optics, flaws=None, count=5, speed_mm=(0.0, 0.0)):
    """Measures tags at random poses on rendered pictures.

    Returns:
        Three rows (3, count): errors of place [mm] and angle [deg], and stated standard deviations [mm].
    """
    calibration, tag = true_calibration(optics), part_tag(on_part=(0.0, 0.0, 0.0))
    results = []
    for seed, pose in enumerate(poses(count, 5)):
        picture = picture_of(optics, pose, flaws=flaws, seed=seed, speed_mm=speed_mm)
        measured = measure.measure(picture, find(picture), calibration, tag)
        off = np.hypot(measured.pose[0] - pose[0], measured.pose[1] - pose[1])
        turn = abs(np.degrees(angle_between(measured.pose[2], pose[2])))
        results.append((off, turn, measured.sigma_mm))
    return np.array(results).T


@pytest.mark.parametrize("optics", [BELOW, ABOVE], ids=["below", "above"])
def test_measure_tag_from_above_and_below_is_exact(optics):
    place, angle, sigma = errors(optics)
    assert place.mean() < 0.05
    assert angle.mean() < 0.15
    assert (place < 3.0 * sigma).all()


@pytest.mark.parametrize("flaws", LIMITS.values(), ids=LIMITS.keys())
def test_measure_tag_at_stated_limits_is_exact(flaws):
    place, angle, _ = errors(BELOW, Flaws(**flaws))
    assert place.mean() < 0.1
    assert angle.mean() < 0.3


def test_measure_moving_tag_is_at_middle_of_exposure():
    place, _, _ = errors(BELOW, speed_mm=(1.2, 0.8))
    assert place.mean() < 0.1


def test_find_corners_are_exact_to_hundredths_of_pixel():
    view, off = true_view(BELOW), []
    print_mm = measure.print_corners(SIDE_MM)
    for seed, (x, y, theta) in enumerate(poses(6, 6)):
        truth = view.pixels_at(placed(print_mm, (x, y, theta)))
        result = find(picture_of(BELOW, (x, y, theta), seed=seed))
        off.append(result[0].corners - truth)
    assert np.sqrt(np.mean(np.square(off))) < 0.06
    assert np.abs(np.mean(off, axis=(0, 1))).max() < 0.03


def test_find_stain_on_side_of_tag_moves_no_corner():
    pose = (20.0, 10.0, 0.0)
    spots = ((), (stain((29.5, 21.1, 0.0), (3.0, 2.2)),))
    clean, stained = (find(picture_of(BELOW, pose, before=cards))[0].corners for cards in spots)
    assert np.abs(clean - stained).max() < 0.15


def test_find_reads_number_of_tag():
    for number in np.random.default_rng(7).integers(0, 587, 12).tolist():
        assert [tag.number for tag in find(picture_of(BELOW, (0.0, 0.0, 0.7), number))] == [number]


def test_find_pattern_without_tag_gives_none():
    rng = np.random.default_rng(8)
    for _ in range(4):
        cells = rng.integers(0, 2, (24, 24)).astype(np.uint8)
        card = lying(cells, 5.0, (0.0, 0.0, 0.4), face_down=True)
        assert find(render(BELOW, [card], Flaws(), rng)) == []


@pytest.mark.parametrize("wrong", [{"side_mm": 24.0}, {"height_mm": 20.0}])
def test_measure_tag_of_other_size_or_height_is_refused(wrong):
    picture = picture_of(BELOW, (0.0, 0.0, 0.2))
    with pytest.raises(PictureError, match=r"looks .* mm large"):
        measure.measure(picture, find(picture), true_calibration(BELOW), part_tag(**wrong))
