"""Simulated cameras for tests: for speed, they have half a webcam's resolution and half its distance."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.camera.calibration.file import CameraCalibration, Reference, Trust, save
from drivers.camera.vision import tag_file
from drivers.camera.vision.arrays import Picture
from drivers.camera.vision.lens import Lens
from drivers.camera.vision.plane import View
from drivers.camera.vision.tag_file import PartTag
from drivers.sim.camera.cards import Card, lying
from drivers.sim.camera.optics import Optics, webcam
from drivers.sim.camera.render import Flaws
from drivers.sim.camera.rig import Rig, standard_rig
from runtime.shell.errors import UnreachableError
from runtime.table import GoalSpec

DATE = "2026-01-01T00:00:00+00:00"
SIZE = (960, 540)
SIDE_MM = 22.0
NUMBER = 7
REFERENCES = ((580, (-90.0, -60.0, 0.0)), (581, (90.0, -60.0, 0.5)), (582, (90.0, 60.0, -0.9)))
GOAL = GoalSpec(3_000, 990_000, 10_000, 1)
RECTANGLE = np.array([(-15.0, -10.5), (15.0, -10.5), (15.0, 10.5), (-15.0, 10.5)])


def camera(*, below: bool = True) -> Optics:
    """A camera 300 mm below or above the table, slightly tilted."""
    return webcam((5.0, -7.0, -300.0 if below else 300.0), (2.0, -3.0), 5.0, SIZE)


def rig(optics: Optics, **flaws: object) -> Rig:
    """Returns a camera with the reference tags and the part's tag before it; `flaws` impair its pictures."""
    return Rig(optics, Flaws(**flaws), NUMBER, SIDE_MM, (2.0, -1.0, 0.3), REFERENCES)


class Shown:
    """A source of pictures that come from the function `take`.

    If `take` returns None, the source raises the error of an absent camera.
    """

    def __init__(self, take: Callable[[], Picture | None]) -> None:
        self._take = take

    def picture(self, until: float) -> Picture:
        del until
        picture = self._take()
        if picture is None:
            raise UnreachableError("camera /dev/video0 has not sent a picture yet; check power")
        return picture

    def close(self) -> None:
        pass


def stain(pose: tuple[float, float, float], size_mm: tuple[float, float]) -> Card:
    """Returns a card that shows a dark rectangle on the table to a camera below the table.

    `pose` is (x mm, y mm, rad); `size_mm` is the size along x and y.
    """
    columns, rows = (round(5.0 * size) for size in size_mm)
    card = lying(np.zeros((rows, columns), np.uint8), 0.2, pose, face_down=True, margin_mm=0.0)
    return replace(card, tones=(0.25, 1.0))


def true_view(optics: Optics) -> View:
    """Returns the view that a perfect calibration of the camera would find."""
    focal = (optics.focal, optics.focal)
    lens = Lens(optics.width, optics.height, focal, optics.centre, optics.distortion)
    return View(lens, optics.rotation, -optics.rotation @ optics.eye_mm)


def true_calibration(optics: Optics, references: bool = True) -> CameraCalibration:
    """Returns a perfect calibration, which states a standard deviation of 0.02 mm everywhere on the table.

    With `references` false, the calibration lists no reference tags.
    """
    stuck = REFERENCES if references else ()
    places = tuple(Reference(number, x, y) for number, (x, y, _) in stuck)
    axes = np.array([-400.0, 400.0]), np.array([-250.0, 250.0])
    trust = Trust(*axes, np.full((2, 2), 0.02))
    return CameraCalibration("S-1", DATE, true_view(optics), 0.05, 0.1, trust, places, 18)


def keep_standard(folder: Path) -> None:
    """Writes camera.json and tag.json, which describe the camera and the part's tag of a simulated cell."""
    rig = standard_rig()
    places = tuple(Reference(number, x, y) for number, (x, y, _) in rig.references)
    save(replace(true_calibration(rig.optics), references=places), folder / "camera.json")
    tag_file.save(part_tag(on_part=rig.on_part), folder / "tag.json", DATE)


def part_tag(**values: object) -> PartTag:
    """Returns the part's tag as `rig` places it; `values` replace fields of the tag."""
    usual = {"part": "block", "number": NUMBER, "side_mm": SIDE_MM, "on_part": (2.0, -1.0, 0.3)}
    return PartTag(**{**usual, **values})


def angle_between(a: float, b: float) -> float:
    """The angle from b to a, in [-pi, pi) rad."""
    return float(np.remainder(a - b + np.pi, 2.0 * np.pi) - np.pi)
