"""The audit's verdicts on displaced parts, by eq. 9, and its sentences about pictures that cannot be used.

A verdict respects the part's symmetry. It is given only if the distance of eq. 9 differs from the goal by
more than the error of the measurement.
"""

import math
import os
import re
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from cameras import (
    GOAL,
    NUMBER,
    RECTANGLE,
    SIDE_MM,
    Shown,
    camera,
    part_tag,
    rig,
    stain,
    true_calibration,
)
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.audit import overlay
from drivers.camera.audit.auditor import COVERAGE, FAIL, PASS, UNKNOWN, Auditor, Subject, judge
from drivers.camera.audit.overlay import MEASURED, PREDICTED, keep
from drivers.sim.camera.cards import lying, tag_cells
from drivers.sim.camera.optics import webcam
from drivers.sim.camera.render import Flaws, render
from drivers.sim.physics.tabletop import Look
from runtime.table import Tolerance

BELOW = camera()
RIG = rig(BELOW)
POSE = (10.0, -5.0, 0.8)
SUBJECT = Subject(GOAL, part_tag(), RECTANGLE)
COORDINATE = st.floats(-20.0, 20.0)
ANGLE = st.floats(-math.pi, math.pi)


def shot(part=POSE, seed=1):
    return RIG.seen(Look(part), np.random.default_rng(seed))


def audit(picture, predicted=POSE, calibration=None, pictures=None, subject=SUBJECT):
    known = calibration or true_calibration(BELOW)
    auditor = Auditor(Shown(lambda: picture), known, [subject], pictures=pictures)
    return auditor.audit(3, predicted, time.monotonic() + 1.0)


def with_cards(*extra, part=POSE, optics=BELOW):
    return render(optics, [*RIG.cards(part), *extra], Flaws(), np.random.default_rng(1))


def tag_at(pose, number, cells=None):
    cells = tag_cells(number) if cells is None else cells
    return lying(cells, SIDE_MM / len(cells), pose, face_down=True)


def tag_of_other_family():
    """A tag of another family, 25h9, which lies where the part should be."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_25h9)
    return tag_at(POSE, 3, cv2.aruco.generateImageMarker(family, 3, 7) // 255)


# -- the verdict ----------------------------------------------------------------------------------


JUDGED = {(0.2, 0.1, 0.01): PASS, (0.0, 0.0, 0.4): FAIL}
JUDGED |= dict.fromkeys([(2.0, 3.0, 0.0), (1.0, 1.0, 0.25)], FAIL)


@pytest.mark.parametrize(("off", "verdict"), JUDGED.items())
def test_audit_displaced_part_has_verdict_and_distance(off, verdict):
    answer = audit(shot(), tuple(np.subtract(POSE, off)))
    assert answer.verdict == verdict
    truth = math.hypot(*off[:2]) + GOAL.rho_um / 1e3 * off[2]
    assert abs(answer.distance - truth) < answer.error
    assert np.abs(np.subtract(answer.residual, off)).max() < 0.05


def test_audit_part_at_threshold_is_unknown():
    answer = audit(shot(), (POSE[0] - GOAL.distance_um / 1e3, *POSE[1:]))
    assert answer.verdict == UNKNOWN
    assert "too close to call" in answer.reason


@given(COORDINATE, COORDINATE, ANGLE, st.integers(1, 6), st.integers(-6, 6))
def test_judge_turn_by_symmetry_changes_nothing(x, y, theta, order, turns):
    goal = replace(GOAL, symmetry=order)
    there = judge(goal, [(0.0, 0.0, 0.2)], (x, y, theta), 0.05, 0.001)
    again = judge(goal, [(0.0, 0.0, 0.2)], (x, y, theta + turns * math.tau / order), 0.05, 0.001)
    assert abs(there.distance - again.distance) < 1e-9
    assert abs(there.residual[2]) <= math.pi / order + 1e-12


@given(COORDINATE, COORDINATE, ANGLE, st.floats(0.0, 0.5), st.floats(0.0, 0.05))
def test_judge_verdict_is_given_only_beyond_error(x, y, theta, sigma_mm, sigma_rad):
    judged = judge(GOAL, [(0.0, 0.0, 0.0)], (x, y, theta), sigma_mm, sigma_rad)
    by_hand = math.hypot(x, y) + 10.0 * min(abs(theta), math.tau - abs(theta))
    assert abs(judged.distance - by_hand) < 1e-9
    assert abs(judged.error - COVERAGE * math.hypot(sigma_mm, 10.0 * sigma_rad)) < 1e-12
    assert (judged.verdict == PASS) == (by_hand + judged.error < 3.0)
    assert (judged.verdict == FAIL) == (by_hand - judged.error >= 3.0)


def test_judge_part_at_any_allowed_pose_passes():
    goal, poses = replace(GOAL, kind="modes"), [(0.0, 0.0, 0.0), (20.0, 0.0, 1.0)]
    assert judge(goal, poses, (20.5, 0.0, 1.0), 0.05, 0.001).verdict == PASS
    assert judge(goal, poses[:1], (20.5, 0.0, 1.0), 0.05, 0.001).verdict == FAIL


@pytest.mark.parametrize(
    ("kind", "off", "verdict"),
    [
        ("tolerances", (2.0, 2.0, 0.05), PASS),
        ("tolerances", (3.0, 0.0, 0.0), FAIL),
        ("tolerances", (0.0, 2.45, 0.0), UNKNOWN),
        ("tolerances", (0.0, 0.0, 0.1), FAIL),
        ("orientation", (50.0, 50.0, 0.05), PASS),
        ("orientation", (0.0, 0.0, 0.1), FAIL),
    ],
)
def test_judge_other_goals_use_their_tolerances(kind, off, verdict):
    tolerance = Tolerance(2_500, 2_500, round(1e6 * math.radians(5.0)))
    goal = replace(GOAL, kind=kind, tolerance=tolerance)
    assert judge(goal, [(0.0, 0.0, 0.0)], off, 0.05, 0.001).verdict == verdict


# -- unusable pictures ----------------------------------------------------------------------------

BESIDE = (-60.0, 20.0, 0.0)
HALF = stain((POSE[0] + 29.5, POSE[1], 0.0), (61.0, 80.0))


WRONG = {
    "no camera": (lambda: None, "has not sent a picture"),
    "black": (lambda: np.zeros((540, 960), np.uint8), "picture is black"),
    "white": (lambda: np.full((540, 960), 255, np.uint8), "picture is white"),
    "grey": (lambda: np.full((540, 960), 90, np.uint8), "of one grey"),
    "no tag": (lambda: shot(None), "no tag is seen; tag 7 must be in view"),
    "two tags": (lambda: with_cards(tag_at(BESIDE, 9)), r"more than one tag .*7, 9"),
    "the same tag twice": (lambda: with_cards(tag_at(BESIDE, NUMBER)), "2 times tag 7"),
    "wrong family": (lambda: with_cards(tag_of_other_family(), part=None), "family 25h9"),
    "wrong id": (lambda: with_cards(tag_at(POSE, 9), part=None), "tag 9 is seen, but the part"),
    "half covered": (lambda: with_cards(HALF), "tag 7 is partly covered"),
    "resolution": (lambda: cv2.resize(shot(), (1280, 720)), "1280 x 720, .* for 960 x 540"),
}


@pytest.mark.parametrize(("picture", "sentence"), WRONG.values(), ids=WRONG)
def test_audit_unusable_picture_is_unknown_with_reason(picture, sentence):
    answer = audit(picture())
    assert answer.verdict == UNKNOWN
    assert answer.measured is None
    assert re.search(sentence, answer.reason), answer.reason


def test_audit_moved_camera_is_unknown():
    moved = webcam((7.0, -7.0, -300.0), (2.0, -3.0), 5.0, (960, 540))
    answer = audit(with_cards(optics=moved))
    assert answer.verdict == UNKNOWN
    assert "the camera or the tag moved; calibrate again" in answer.reason
    assert audit(shot()).moved_mm < 0.1


@pytest.mark.parametrize(
    ("references", "message"),
    [(True, "reference tag 580 is seen beyond the table's"), (False, "tag 7 is seen beyond")],
)
def test_audit_tag_beyond_horizon_is_unknown(references, message):
    known = true_calibration(BELOW, references=references)
    away = np.diag([1.0, -1.0, -1.0]) @ known.view.rotation  # looks away from the table
    view = replace(known.view, rotation=away, translation=-away @ known.view.eye)
    cards = RIG.cards(POSE)[0 if references else -1 :]
    picture = render(BELOW, cards, Flaws(), np.random.default_rng(1))
    answer = audit(picture, calibration=replace(known, view=view))
    assert answer.verdict == UNKNOWN
    assert message in answer.reason
    assert "nan" not in str(answer.fields())


def test_audit_without_reference_tags_is_unknown_and_one_suffices():
    bare = rig(BELOW)
    alone = bare.cards(POSE)[-1:]
    picture = render(BELOW, alone, Flaws(), np.random.default_rng(1))
    assert "no reference tag (580, 581, 582) is seen" in audit(picture).reason
    one = render(BELOW, bare.cards(POSE)[2:], Flaws(), np.random.default_rng(1))
    assert audit(one).verdict == PASS


# -- the picture ----------------------------------------------------------------------------------


def test_audit_keeps_overlay_unless_passed(tmp_path):
    album = tmp_path / "pictures"
    assert audit(shot(), pictures=album).picture is None
    failed = audit(shot(), (POSE[0] - 5.0, *POSE[1:]), pictures=album)
    unseen = audit(shot(None), pictures=album)
    names = {path.name for path in album.iterdir()}
    assert names == {f"part-0000003-{verdict}.jpg" for verdict in ("fail", "unknown")}
    assert failed.picture == str(album / "part-0000003-fail.jpg")
    drawn = cv2.imread(failed.picture).astype(int)
    assert drawn.shape == (540, 960, 3)
    for colour in (PREDICTED, MEASURED):
        assert (np.abs(drawn - colour).max(axis=-1) < 60).sum() > 50
    assert unseen.fields().keys() == {"verdict", "reason", "picture"}


def test_keep_limits_album_and_survives_write_error(tmp_path, monkeypatch):
    monkeypatch.setattr(overlay, "MOST_PICTURES", 3)
    picture = np.zeros((20, 20, 3), np.uint8)
    for part in range(6):
        assert keep(tmp_path / "a", part, FAIL, picture) is not None
    assert [p.name for p in sorted((tmp_path / "a").iterdir())] == [
        f"part-{k:07d}-fail.jpg" for k in (3, 4, 5)
    ]
    (tmp_path / "b").write_text("in the way")
    assert keep(tmp_path / "b", 0, FAIL, picture) is None


def test_keep_full_folder_and_parts_from_one_again_deletes_the_oldest(tmp_path, monkeypatch):
    monkeypatch.setattr(overlay, "MOST_PICTURES", 2)
    for age_s, part in ((30, 8), (20, 9), (10, 1), (0, 2)):
        path = keep(tmp_path, part, FAIL, np.zeros((20, 20, 3), np.uint8))
        os.utime(path, (1e9 - age_s, 1e9 - age_s))
    assert {path.name[:12] for path in tmp_path.iterdir()} == {"part-0000001", "part-0000002"}


def parts(goal):
    """Two parts, "l" and "r", with different tags."""
    return Subject(goal, part_tag(), name="l"), Subject(goal, part_tag(number=NUMBER + 1), name="r")


def audit_of_several(lies, said, *subjects, predicted=POSE):
    """The auditor's answer to a picture of one part.

    `lies` is the number of the part in the picture, and `subjects` are the parts that the auditor knows. The
    table stated the part with the name `said` at the pose `predicted`.
    """
    picture = RIG.seen(Look(POSE, hypothesis=lies), np.random.default_rng(1))
    auditor = Auditor(Shown(lambda: picture), true_calibration(BELOW), subjects)
    return auditor.audit(3, predicted, time.monotonic() + 1.0, said)


def test_audit_separate_tags_tell_parts_apart():
    left, right = parts(GOAL)

    def output(lies: int, said: str, *subjects):
        answer = audit_of_several(lies, said, *subjects)
        return answer.verdict, answer.fields().get("hypothesis")

    assert output(0, "l", left, right) == (PASS, "l")
    assert output(1, "r", left, right) == (PASS, "r")
    assert output(1, "l", left, right) == (FAIL, "r")
    alike = replace(right, tag=left.tag)  # so that the audit cannot name the part
    assert output(0, "r", left, alike) == (PASS, None)
    assert output(1, "l", left, alike) == (UNKNOWN, None)
    assert output(0, "l", right) == (UNKNOWN, None)


def test_audit_identity_goal_judges_only_which_part_it_is():
    left, right = parts(replace(GOAL, kind="identity"))
    alike = replace(right, tag=left.tag)

    def output(lies: int, said: str, *subjects):
        answer = audit_of_several(lies, said, *subjects, predicted=(POSE[0] - 40.0, *POSE[1:]))
        return answer.verdict, answer.reason

    assert output(0, "l", left, right) == (PASS, "it is l")
    assert output(0, "r", left, right) == (FAIL, "it is l, not r")
    reason = "the goal asks which part it is, which its tag does not tell"
    assert output(0, "l", left, alike) == (UNKNOWN, reason)
