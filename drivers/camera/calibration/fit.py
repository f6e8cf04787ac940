"""Calibrates a camera from pictures, and measures where a tag is on its part."""

import csv
from argparse import ArgumentTypeError
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from drivers.camera.calibration import lens_fit, table_fit
from drivers.camera.calibration.drift import place
from drivers.camera.calibration.file import CameraCalibration, Reference
from drivers.camera.calibration.measure import of_sighting, the_one
from drivers.camera.calibration.table_fit import Residuals
from drivers.camera.vision.arrays import Picture
from drivers.camera.vision.board import Board, BoardView
from drivers.camera.vision.sources import SUFFIXES, decoded
from drivers.camera.vision.tag_file import PartTag
from drivers.camera.vision.tags import Sighting, find
from drivers.planar import Pose2
from runtime.shell.command import number
from runtime.shell.errors import InputError

ZERO: Pose2 = (0.0, 0.0, 0.0)


class Touched(NamedTuple):
    """A picture of a part with its tag, and the part's pose in the arm's world frame, mm, mm, rad."""

    picture: Path
    pose: Pose2


class Fitted(NamedTuple):
    """Result of `calibrate`: the calibration, its residuals, and the pictures with and without the board."""

    calibration: CameraCalibration  # the calibration
    residuals: Residuals  # residuals of boards on the table
    views: list[BoardView]  # all views of the board, those on the table first
    left_out: list[str]  # pictures in which the board is not seen


class Pictures(NamedTuple):
    """The pictures that a camera is calibrated from, and what they show."""

    held: Sequence[Path]  # pictures of the board held before the camera
    table: Sequence[Path]  # pictures of the board on the table; the first one gives the frame
    touched: Sequence[Touched]  # pictures of the part's tag; empty: the board's frame is the world
    references: Path | None  # picture of the fixed tags; None: there is none
    number: int  # id of the part's tag
    from_below: bool  # whether the camera looks up through the table
    height_mm: float  # height of the board's face above the table


def calibrate(camera: str, date: str, board: Board, pictures: Pictures) -> Fitted:
    """Calibrates lens and pose of a camera, the uncertainty of measured places, and the reference tags.

    Args:
        camera: name or serial number of the camera.
        date: date of the calibration, ISO 8601.
        board: the printed board.
        pictures: pictures of the board and of the tags.

    Raises:
        InputError: a picture cannot be read, or the pictures do not suffice for a reliable calibration.
        PictureError: a file is not a picture.
    """
    held, table, touched, references, number, from_below, height_mm = pictures
    size, views, left_out = _views(board, [*table, *(path for path in held if path not in table)])
    lying = [view for view in views if view.name in {path.name for path in table}]
    if not lying or lying[0].name != table[0].name:
        raise InputError(f"{table[0].name}: the board on the table is not seen; take it again")
    result = lens_fit.fit(views, size)
    view = table_fit.stand(result.lens, result.pose, from_below, height_mm)
    world, alignment_mm = ZERO, 0.0
    if touched:
        seen = [place(_only_tag(known.picture, number), view) for known in touched]
        world, alignment_mm = table_fit.align([known.pose[:2] for known in touched], seen)
    view = view.moved(world)
    residuals = table_fit.board_residuals(view, lying, height_mm)
    trust = table_fit.trust(result, view, height_mm, world)
    fixed = [tag for tag in _tags(references) if tag.number != number] if references else []
    if references and not fixed:
        raise InputError(f"{references.name}: no reference tag is seen; take it again")
    places = tuple(Reference(tag.number, *place(tag, view)) for tag in fixed)
    errors = result.rms_px, alignment_mm
    calibration = CameraCalibration(camera, date, view, *errors, trust, places, len(views))
    return Fitted(calibration, residuals, views, left_out)


def glue(calibration: CameraCalibration, tag: PartTag, touched: Sequence[Touched]) -> PartTag:
    """Measures where a tag is on its part, from pictures of the part at known poses.

    Args:
        calibration: the camera's calibration.
        tag: the tag, with its pose on the part set to zero.
        touched: the part's poses, and their pictures.

    Returns:
        The tag with its measured pose on the part, and the standard deviations of that pose.

    Raises:
        InputError: a picture cannot be read, the tag is not seen, or the poses contradict one another.
        PictureError: a picture has another size, or the tag cannot be measured in it.
    """
    fixed = {reference.number for reference in calibration.references}
    seen = []
    for known in touched:
        picture = load_picture(known.picture)
        calibration.check_size(picture.shape)
        sighting = the_one(find(picture), tag.number, fixed)
        if sighting is None:
            raise InputError(f"{known.picture.name}: tag {tag.number} is not seen; take it again")
        seen.append(of_sighting(sighting, calibration, tag).pose)
    on_part, sigma_mm, sigma_rad = table_fit.part_offset([known.pose for known in touched], seen)
    return replace(tag, on_part=on_part, sigma_mm=sigma_mm, sigma_rad=sigma_rad)


def read_poses(path: Path) -> tuple[Touched, ...]:
    """Reads pictures and known poses of a part from a CSV file; raises InputError if it cannot be read.

    The columns are `picture` (a path relative to the CSV file), `x_mm`, `y_mm` and optionally `theta_rad`.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except OSError as error:
        raise InputError(f"poses {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"poses {path}: is no text; write CSV") from error
    rows = [{} if None in row else row for row in rows]  # with more fields than the first line
    return tuple(_touched(path, line, row) for line, row in enumerate(rows, start=2))


def _touched(path: Path, line: int, row: dict[str, str]) -> Touched:
    try:
        pose = number(row["x_mm"]), number(row["y_mm"]), number(row.get("theta_rad") or "0")
        return Touched(path.parent / row["picture"], pose)
    except (KeyError, TypeError, ValueError, ArgumentTypeError) as error:
        raise InputError(
            f"poses {path}, line {line}: write a picture's name and numbers below the first line "
            "picture,x_mm,y_mm,theta_rad"
        ) from error


def pictures_in(folder: Path) -> tuple[Path, ...]:
    """Returns the pictures of a folder, sorted by name; raises InputError if the folder cannot be read."""
    try:
        return tuple(sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES))
    except OSError as error:
        raise InputError(f"folder {folder}: {error.strerror}") from error


def load_picture(path: Path) -> Picture:
    """Reads a picture in grey levels, (h, w).

    Raises:
        InputError: the file cannot be read.
        PictureError: the file is not a picture.
    """
    try:
        return decoded(path.read_bytes(), str(path))
    except OSError as error:
        raise InputError(f"picture {path}: {error.strerror}") from error


def _views(
    board: Board, paths: Sequence[Path]
) -> tuple[tuple[int, int], list[BoardView], list[str]]:
    """Finds the board in pictures.

    Returns:
        Width and height of the pictures, the views of the board, and the names of pictures without it.

    Raises:
        InputError: the pictures differ in size, or one cannot be read.
    """
    views, left_out = [], []
    sizes: list[tuple[int, int]] = []
    for path in paths:
        picture = load_picture(path)
        height, width = picture.shape
        sizes.append((width, height))
        if sizes[-1] != sizes[0]:
            raise InputError(
                f"{path.name} is {width} x {height}, those before it {sizes[0][0]} x {sizes[0][1]}; "
                "take all at one size"
            )
        view = board.find(picture, path.name)
        if view is None:
            left_out.append(path.name)
        else:
            views.append(view)
    return sizes[0], views, left_out


def _tags(path: Path) -> list[Sighting]:
    return find(load_picture(path))


def _only_tag(path: Path, number: int) -> Sighting:
    results = [tag for tag in _tags(path) if tag.number == number]
    if len(results) != 1:
        raise InputError(f"{path.name}: tag {number} is seen {len(results)} times; take it again")
    return results[0]
