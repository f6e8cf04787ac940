"""Pictures for the calibration of the simulated camera, as drivers/camera/README.md requires them."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from drivers.planar import Pose2
from drivers.sim.camera.cards import Card, board_cells, lying
from drivers.sim.camera.optics import Optics
from drivers.sim.camera.render import Flaws, render
from drivers.sim.camera.rig import Rig
from runtime.shell import files

COLUMNS, ROWS = 12, 9
# Edge of a field as a share of the camera's distance; edge of a marker as a share of a field.
FIELD_SHARE, MARKER_SHARE = 0.05, 0.75
ARM_SIGMA_MM = 0.03  # accuracy of an arm's placements
CORNERS = [(x, y) for x in (0.2, 0.8) for y in (0.28, 0.72)]
TILTED = (
    *((corner, tilt) for corner in CORNERS for tilt in ((0.5, 0.0), (0.0, 0.5))),
    *(((0.5, 0.5), tilt) for tilt in ((0.55, 0.2), (-0.5, -0.3), (0.1, -0.6), (-0.1, 0.6))),
)
# poses on the table, x and y in shares of the camera's distance
SPREAD: tuple[Pose2, ...] = (
    (0.0, 0.0, 0.0),
    *((-0.43, -0.2, 0.05), (0.43, 0.2, -0.1), (-0.43, 0.2, 1.6), (0.43, -0.2, 3.0)),
)


def _field_mm(optics: Optics) -> float:
    """Edge of a square of the ChArUco board, mm: a fixed share of the camera's distance from the table."""
    return FIELD_SHARE * abs(float(optics.eye_mm[2]))


def _on_table(optics: Optics) -> list[Card]:
    """Cards of the board on the table, one for each picture: the first in the middle, the others spread."""
    field, far = _field_mm(optics), abs(float(optics.eye_mm[2]))
    cells, below = board_cells(COLUMNS, ROWS), bool(optics.eye_mm[2] < 0.0)
    places = [(x * far, y * far, turn) for x, y, turn in SPREAD]
    return [lying(cells, field / 8, at, face_down=below, margin_mm=field / 3) for at in places]


def _held(
    optics: Optics, spot: tuple[float, float], tilt: tuple[float, float], rng: np.random.Generator
) -> Card:
    """Card of the board, held in front of the camera, tilted, at a random distance and roll.

    Args:
        optics: the camera.
        spot: x and y of the middle of the board, in shares of the picture.
        tilt: rotation about x and y of the camera, rad.
        rng: draws distance and roll.
    """
    pixel = np.array([spot[0] * optics.width, spot[1] * optics.height])
    ray = np.array([*((pixel - optics.centre) / optics.focal), 1.0])
    middle = rng.uniform(0.70, 1.03) * abs(float(optics.eye_mm[2])) * ray
    roll = rng.uniform(-0.4, 0.4) + rng.choice([0.0, 0.5 * np.pi])
    turn = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
    back = optics.rotation.T
    axes, field = back @ turn, _field_mm(optics)
    cells, centre = board_cells(COLUMNS, ROWS), optics.eye_mm + back @ middle
    return Card(cells, field / 8, field / 3, centre, axes[:, 0], axes[:, 1])


def write(rig: Rig, folder: Path, seed: int, names: Sequence[str] = ()) -> Iterator[str]:
    """Takes all pictures; yields the arguments of each call of `grasp-calibrate` that evaluates them.

    Args:
        rig: the camera and its tags.
        folder: receives the pictures and the tables of poses.
        seed: seed of the noise, the held boards and the errors of the arm.
        names: names of the parts, if there are several.

    Raises:
        OutputError: a file cannot be written.
    """
    rng = np.random.default_rng([seed, 0x414C42])
    flaws = replace(rig.flaws, jpeg_quality=rig.flaws.jpeg_quality or Flaws().jpeg_quality)
    files.folder(folder / "views")

    def take(name: str, cards: Sequence[Card]) -> None:
        with files.writing(folder / name) as draft:
            picture = render(rig.optics, cards, flaws, rng)
            draft.write_bytes(cv2.imencode(".png", picture)[1].tobytes())

    flips = rng.choice([-1.0, 1.0], (len(TILTED), 2))
    held = [
        _held(rig.optics, spot, (tilt[0] * flip[0], tilt[1] * flip[1]), rng)
        for (spot, tilt), flip in zip(TILTED, flips, strict=True)
    ]
    for number, card in enumerate(held):
        take(f"views/{number:02d}.png", [card])
    for number, card in enumerate(_on_table(rig.optics)):
        take(f"table-{number}.png", [card])
    take("references.png", rig.cards(None))
    far = 0.6 * abs(float(rig.optics.eye_mm[2]))
    places = [(x * far, y * far, turn) for x, y, turn in SPREAD]
    shown = {"touched": replace(rig, on_part=(0.0, 0.0, 0.0))}
    # Suffix of the names of a part's files, and its name.
    parts = [(f"-{k}", name) for k, name in enumerate(names)] or [("", "part")]
    for k, (suffix, _) in enumerate(parts):
        shown[f"part{suffix}"] = replace(rig, number=rig.number + k)
    for name, tagged in shown.items():
        # An arm knows poses well, but not exactly.
        rows = [("picture", "x_mm", "y_mm", "theta_rad")]
        for number, (x, y, turn) in enumerate(places):
            take(f"{name}-{number}.png", tagged.cards((x, y, turn)))
            off = rng.normal(0.0, ARM_SIGMA_MM, 2)
            place = (f"{x + off[0]:.4f}", f"{y + off[1]:.4f}", f"{turn}")
            rows.append((f"{name}-{number}.png", *place))
        files.write(folder / f"{name}.csv", "\n".join(map(",".join, rows)) + "\n")
    yield from _commands(rig, folder, parts)


def _commands(rig: Rig, folder: Path, parts: Sequence[tuple[str, str]]) -> Iterator[str]:
    def at(name: str) -> str:
        return shlex.quote(str(folder / name))

    tables = " ".join(at(f"table-{number}.png") for number in range(len(SPREAD)))
    field_mm = _field_mm(rig.optics)
    board = f"charuco:{COLUMNS}x{ROWS}:{field_mm:g}:{MARKER_SHARE * field_mm:g}"
    yield (
        f"camera --name simulated --board {board} --views {at('views')} --table {tables} "
        f"--touched {at('touched.csv')} --number {rig.number} --references {at('references.png')} "
        f"{'' if rig.below else '--above '}-o {at('camera.json')}"
    )
    for k, (suffix, name) in enumerate(parts):
        yield (
            f"tag --part {shlex.quote(name)} --number {rig.number + k} --side {rig.side_mm:g} "
            f"--calibration {at('camera.json')} --poses {at(f'part{suffix}.csv')} "
            f"-o {at(f'tag{suffix}.json')}"
        )
