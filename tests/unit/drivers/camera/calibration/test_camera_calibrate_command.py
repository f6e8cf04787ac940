"""`grasp-calibrate camera` and `tag` on rendered pictures: exact to 0.1 mm; mistakes give one line."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from boards import OPTICS, cards, corners_on_board, places
from cameras import NUMBER, SIDE_MM, angle_between, part_tag, rig

from drivers.camera.calibration import command as calibrate_command
from drivers.camera.calibration import file as calibration
from drivers.camera.calibration.fit import read_poses
from drivers.camera.vision import tag_file
from drivers.planar import compose
from drivers.sim.camera.render import Flaws, render
from drivers.sim.physics.tabletop import Look
from runtime.shell.errors import InputError


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A folder of rendered pictures: the board on the table and in the hand, a tag, the reference tags."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "views").mkdir()
    rng = np.random.default_rng(6)
    shown = rig(OPTICS)
    for number, card in enumerate(cards()):
        name = "table.png" if number == 0 else f"views/held-{number:02d}.png"
        cv2.imwrite(str(folder / name), render(OPTICS, [card], Flaws(), rng))
    parts = [(-60.0, -20.0, 0.4), (60.0, -30.0, 2.0), (0.0, 40.0, -1.0), (-50.0, 40.0, 3.0)]
    poses, touched = ["picture,x_mm,y_mm,theta_rad"], ["picture,x_mm,y_mm"]
    for number, part in enumerate(parts):
        cv2.imwrite(str(folder / f"part-{number}.png"), shown.seen(Look(part), rng))
        poses.append(f"part-{number}.png,{part[0]},{part[1]},{part[2]}")
        x, y, _ = compose(part, shown.on_part)
        touched.append(f"part-{number}.png,{x},{y}")
    for name, lines in (("poses", poses), ("touched", touched)):
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    cv2.imwrite(str(folder / "empty.png"), shown.seen(Look(None), rng))
    return folder


def run_camera(studio, *more):
    words = ["camera", "--json", "--name", "S-1", "--board", "charuco:12x9:14:10.5"]
    words += [f"--views={studio}/views", f"--table={studio}/table.png", f"-o{studio}/camera.json"]
    return calibrate_command.main([*words, *more])


@pytest.fixture(scope="module")
def calibrated(studio):
    touched = ["--touched", str(studio / "touched.csv"), "--number", str(NUMBER)]
    assert run_camera(studio, *touched, "--references", str(studio / "empty.png")) == 0
    return calibration.load(studio / "camera.json")


def test_calibrate_camera_rendered_views_fit_to_tenth_of_millimetre(calibrated):
    where, pixels = places()
    off = np.hypot(*(calibrated.view.on_plane(pixels) - where).T)
    assert off.mean() < 0.1
    assert off.max() < 0.4
    assert [reference.number for reference in calibrated.references] == [580, 581, 582]
    assert calibrated.date
    first = calibrated.references[0]
    assert np.hypot(first.x_mm + 90.0, first.y_mm + 60.0) < 0.2


def test_calibrate_camera_writes_residual_picture(studio, calibrated):
    picture = Path(studio / "camera.svg").read_text()
    assert picture.startswith("<svg")
    assert picture.count("<circle") == len(corners_on_board())
    assert calibrated.camera in picture


def test_calibrate_pictures_prompts_on_stderr_and_prints_json(
    studio, tmp_path, monkeypatch, capsys
):
    asked = []
    monkeypatch.setattr("builtins.input", lambda: asked.append(capsys.readouterr().err))
    words = ["pictures", "--camera", str(studio / "views"), "--count", "2", "--json"]
    words += ["-o", str(tmp_path)]
    assert calibrate_command.main(words) == 0
    record = json.loads(capsys.readouterr().out)
    assert record == {"pictures": [str(tmp_path / f"view-00{number}.png") for number in (0, 1)]}
    assert ["press Enter" in sentence for sentence in asked] == [True, True]


def test_calibrate_tag_from_pictures_is_located_on_part(studio, calibrated, capsys):
    words = ["tag", "--part", "block", "--number", str(NUMBER), "--side", str(SIDE_MM)]
    words += ["--calibration", str(studio / "camera.json"), "--poses", str(studio / "poses.csv")]
    assert calibrate_command.main([*words, "-o", str(studio / "tag.json")]) == 0
    tag = tag_file.load(studio / "tag.json")
    assert np.hypot(tag.on_part[0] - 2.0, tag.on_part[1] + 1.0) < 0.1
    assert abs(angle_between(tag.on_part[2], 0.3)) < 0.005
    assert "standard deviation" in capsys.readouterr().out


def test_calibrate_tag_stated_place_is_saved(tmp_path, capsys):
    words = ["tag", "--part", "block", "--number", "7", "--side", "22", "--at", "2,-1,0.3"]
    assert calibrate_command.main([*words, "--json", "-o", str(tmp_path / "tag.json")]) == 0
    assert tag_file.load(tmp_path / "tag.json") == part_tag()
    record = json.loads(capsys.readouterr().out)
    names = ("part", "tag", "x_mm", "theta_rad", "output")
    assert [record[name] for name in names] == ["block", 7, 2.0, 0.3, str(tmp_path / "tag.json")]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--side", "nan"], "'nan' is not a number"),
        (["--side", "-22"], "'-22' is not a positive number"),
        (["--height", "inf"], "'inf' is not a number"),
        (["--number", "587"], "no tag of the family 36h11"),
        (["--at", "nan,0,0"], "'nan' is not a number"),
        (["--at", "0,0"], "write X,Y,THETA"),
        (["-o", "."], "'.' is no name of a file"),
    ],
)
def test_calibrate_tag_value_without_a_meaning_is_refused(tmp_path, capsys, more, sentence):
    words = ["tag", "--part", "block", "--number", "7", "--side", "22", "--at", "2,-1,0.3"]
    with pytest.raises(SystemExit) as ended:
        calibrate_command.main([*words, "-o", str(tmp_path / "tag.json"), *more])
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n"), sentence in said) == (2, 1, True), said


@pytest.mark.parametrize(
    ("more", "code", "sentence"),
    [
        (["--above", "--touched", "touched.csv", "--number", "7"], 3, "disagree by"),
        (["--views", "nowhere"], 3, "folder nowhere"),
        (["--board", "charuco:5x4:14:10.5"], 3, "the board on the table is not seen"),
        (["--references", "table.png"], 3, "no reference tag is seen"),
        (["--touched", "empty.png"], 3, "poses"),
    ],
)
def test_calibrate_camera_mistake_is_reported_in_one_line(
    studio, capsys, monkeypatch, more, code, sentence
):
    monkeypatch.chdir(studio)
    assert run_camera(studio, *more) == code
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    "row", ["a.png,1.0,here", "a.png,1.0", "1.0", "a.png,nan,1", "a.png,1,5,2,0,0"]
)
def test_read_poses_bad_row_is_named(row, tmp_path):
    result = tmp_path / "poses.csv"
    result.write_text(f"picture,x_mm,y_mm\nb.png,1.0,2.0\n{row}\n")
    with pytest.raises(InputError, match=r"poses\.csv, line 3: write a picture's name and num"):
        read_poses(result)


def test_read_poses_without_header_or_not_text_is_refused(tmp_path):
    result = tmp_path / "poses.csv"
    result.write_text("a.png,1.0,2.0\nb.png,1.0,2.0\n")
    with pytest.raises(InputError, match="below the first line picture,x_mm,y_mm,theta_rad"):
        read_poses(result)
    result.write_bytes(bytes(range(128, 256)))
    with pytest.raises(InputError, match="is no text"):
        read_poses(result)


def test_calibrate_camera_pictures_of_two_sizes_are_refused(studio, tmp_path, capsys):
    views = tmp_path / "views"
    views.mkdir()
    cv2.imwrite(str(views / "small.png"), np.zeros((120, 160), np.uint8))
    assert run_camera(studio, "--views", str(views)) == 3
    said = capsys.readouterr().err
    assert re.search(r"small.png is 160 x 120, those before it \d+ x \d+; take all", said)
