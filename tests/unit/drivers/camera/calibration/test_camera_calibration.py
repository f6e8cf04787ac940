"""A calibration recovers the camera, states its own error, and refuses unsuitable pictures and files."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from boards import ON_TABLE, OPTICS, VIEW, cards, corners_on_board, held, places, seen
from cameras import SIZE, camera, part_tag, true_calibration, true_view

from drivers.camera.calibration import file as calibration
from drivers.camera.calibration import lens_fit, table_fit
from drivers.camera.calibration.fit import load_picture
from drivers.camera.vision import tag_file
from drivers.camera.vision.board import parse
from drivers.planar import relative
from drivers.sim.camera.cards import board_cells, lying
from runtime.shell.errors import InputError
from runtime.shell.files import OutputError


def views(noise_px=0.05, seed=1):
    rng = np.random.default_rng(seed)
    return [seen(card, f"view {k}", rng, noise_px) for k, card in enumerate(cards())]


def made_view(result):
    view = table_fit.stand(result.lens, result.pose, from_below=True)
    return view.moved(relative(ON_TABLE, (0.0, 0.0, 0.0)))


# -- the fit --------------------------------------------------------------------------------------


def test_lens_fit_exact_corners_give_camera():
    result = lens_fit.fit(views(noise_px=0.0), SIZE)
    assert result.rms_px < 0.005
    assert np.abs(result.lens.matrix - VIEW.lens.matrix).max() < 0.05
    where, pixels = places()
    assert np.hypot(*(made_view(result).on_plane(pixels) - where).T).max() < 0.01


def test_trust_matches_actual_errors():
    # A squared error in units of its variance has the mean 2 where both directions are equally uncertain,
    # and a smaller one otherwise, since `Trust` states the worse direction.
    where, pixels = places()
    ratios = []
    for seed in range(8):
        result = lens_fit.fit(views(seed=seed), SIZE)
        view = made_view(result)
        off = np.hypot(*(view.on_plane(pixels) - where).T)
        trust = table_fit.trust(result, view, 0.0, relative(ON_TABLE, (0.0, 0.0, 0.0)))
        ratios.append(np.mean([(e / trust.at(*p)) ** 2 for e, p in zip(off, where, strict=True)]))
    assert 0.4 < np.mean(ratios) < 2.0


def test_trust_camera_seeing_horizon_is_refused():
    result = lens_fit.fit(views(noise_px=0.0), SIZE)
    view = made_view(result)
    tilt, _ = cv2.Rodrigues(np.array([np.radians(75.0), 0.0, 0.0]))
    tilted = replace(view, rotation=tilt @ view.rotation)
    with pytest.raises(InputError, match="beyond the horizon of the table; tilt the camera less"):
        table_fit.trust(result, tilted, 0.0, (0.0, 0.0, 0.0))


def test_trust_at_is_interpolated_and_grows_outside_grid():
    axis = np.array([0.0, 10.0])
    trust = calibration.Trust(axis, axis, np.array([[0.1, 0.2], [0.3, 0.4]]))
    assert trust.at(5.0, 5.0) == pytest.approx(0.25)
    assert trust.at(0.0, 10.0) == pytest.approx(0.3)
    assert trust.at(20.0, 10.0) > trust.at(12.0, 10.0) > trust.at(10.0, 10.0)


def test_stand_camera_above_is_located_above():
    optics = camera(below=False)
    card = lying(board_cells(12, 9), 14.0 / 8, ON_TABLE, face_down=False)
    points = corners_on_board()
    pixels = optics.project(card.centre_mm + points[:, :1] * card.right + points[:, 1:] * card.down)
    view = true_view(optics)
    solid, bent = np.column_stack([points, np.zeros(len(points))]), np.array(view.lens.distortion)
    _, turn, shift = cv2.solvePnP(solid, pixels, view.lens.matrix, bent)
    stands = table_fit.stand(view.lens, np.concatenate([turn, shift]).ravel(), from_below=False)
    assert not stands.from_below
    eye = stands.moved(relative(ON_TABLE, (0.0, 0.0, 0.0))).eye
    assert np.abs(eye - optics.eye_mm).max() < 0.01


# -- what is refused ------------------------------------------------------------------------------


def shuffled(view):
    noise = np.random.default_rng(3).normal(0, 3.0, view.pixels.shape)
    return view._replace(pixels=view.pixels + noise)


def flat_views():
    """Views of boards that are never tilted: a longer focal length looks the same as a smaller distance."""
    spots = [(200, 150), (760, 150), (200, 390), (760, 390), (480, 270)]
    rng = np.random.default_rng(4)
    flat = [held((0.0, 0.0), spots[k % 5], 230.0) for k in range(10)]
    return [seen(card, f"view {k}", rng, 0.2) for k, card in enumerate(flat)]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda result: result[:5], "5 pictures show the board; take at least 8"),
        (
            lambda result: [v for v in result * 2 if v.pixels[:, 1].max() < 420],
            "the lower .* corner",
        ),
        (lambda result: [*result[:-1], shuffled(result[-1])], "worst .* in view 9; leave that"),
        (lambda result: [shuffled(v) for v in result], "the residual is"),
        (lambda _: flat_views(), "tilted by 30 degrees"),
    ],
)
def test_lens_fit_unsuitable_views_are_refused(change, sentence):
    with pytest.raises(InputError, match=sentence):
        lens_fit.fit(change(views()), SIZE)


@pytest.mark.parametrize(
    ("touched", "sentence"),
    [
        ([(0, 0), (100, 0)], "2 touched places"),
        ([(0, 0), (10, 0), (0, 10)], "within 14 mm"),
        ([(0, 0), (100, 0), (0, 90)], "disagree by"),
    ],
)
def test_align_unsuitable_touched_places_are_refused(touched, sentence):
    with pytest.raises(InputError, match=sentence):
        table_fit.align(touched, [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)][: len(touched)])


def test_part_offset_too_few_or_contradicting_poses_are_refused():
    with pytest.raises(InputError, match="2 poses"):
        table_fit.part_offset([(0, 0, 0)] * 2, [(0, 0, 0)] * 2)
    with pytest.raises(InputError, match="scatters by"):
        table_fit.part_offset([(0, 0, 0)] * 3, [(0, 0, 0), (5, 0, 0), (0, 5, 0)])


def test_board_residuals_bent_board_is_refused():
    bent = views(0.0)[0]
    bent = bent._replace(pixels=bent.pixels + 4.0 * np.sin(bent.points / 9.0))
    with pytest.raises(InputError, match="check that they lie flat"):
        table_fit.board_residuals(VIEW, [bent])


BOARDS = ["charuco:12x9:30", "chessboard:12x9:30:20", "dots:4x4:3", "charuco:12x9:5:6", ""]


@pytest.mark.parametrize("text", BOARDS)
def test_parse_malformed_board_is_refused(text):
    with pytest.raises(InputError, match="write charuco"):
        parse(text)


# -- the files ------------------------------------------------------------------------------------


def test_calibration_load_returns_what_was_saved(tmp_path):
    known = true_calibration(OPTICS)
    calibration.save(known, tmp_path / "camera.json")
    again = calibration.load(tmp_path / "camera.json")
    calibration.save(again, tmp_path / "again.json")
    assert (tmp_path / "camera.json").read_bytes() == (tmp_path / "again.json").read_bytes()
    assert again.view.lens == known.view.lens
    assert np.array_equal(again.view.rotation, known.view.rotation)
    assert again.references == known.references
    assert {"camera", "date", "sha256"} < json.loads((tmp_path / "camera.json").read_text()).keys()


def test_tag_file_load_returns_what_was_saved(tmp_path):
    tag = part_tag(height_mm=0.3, sigma_mm=0.1, sigma_rad=0.002)
    tag_file.save(tag, tmp_path / "tag.json", "2026-01-01T00:00:00+00:00")
    assert tag_file.load(tmp_path / "tag.json") == tag


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda text: text.replace("1", "2", 1), "checksum does not match"),
        (lambda text: text[: len(text) // 2], "is not JSON"),
        (lambda text: text.replace("camera calibration", "part tag"), "is no camera calibration"),
        (lambda _: "[1]", "is no camera calibration"),
        (lambda _: "\x00\xff", "is not JSON"),
    ],
)
def test_calibration_load_damaged_file_is_refused(tmp_path, spoil, sentence):
    path = tmp_path / "camera.json"
    calibration.save(true_calibration(OPTICS), path)
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError, match=sentence):
        calibration.load(path)


def test_calibration_missing_or_unwritable_file_is_reported(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        calibration.load(tmp_path / "none.json")
    with pytest.raises(OutputError, match="cannot be written"):
        calibration.save(true_calibration(OPTICS), tmp_path / "none" / "camera.json")
    with pytest.raises(InputError, match="No such file"):
        load_picture(tmp_path / "none.png")
