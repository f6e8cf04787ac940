"""A camera above or below a table, and its view of the table's plane: z = 0, z pointing up.

A tag is measured where the rays of its corners meet its plane, whose height is known. Fitting all six
parameters of the tag's pose would trade depth for tilt, with errors of millimetres.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.camera.vision.arrays import Array
from drivers.camera.vision.lens import Lens
from drivers.planar import Pose2


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Lens and pose of a camera: p_camera = rotation p_world + translation."""

    lens: Lens  # the lens
    rotation: Array  # (3, 3)
    translation: Array  # (3,) mm

    @property
    def eye(self) -> Array:
        """Position of the camera in the world, (3,) mm."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def from_below(self) -> bool:
        """Whether the camera looks up through the table."""
        return bool(self.eye[2] < 0.0)

    def on_plane(self, pixels: Array, height_mm: float = 0.0) -> Array:
        """Intersects rays of pixels (n, 2) with a level plane; returns (n, 2) world x and y, mm.

        A ray that does not meet the plane has NaN.
        """
        rays = self.lens.rays(np.asarray(pixels, np.float64).reshape(-1, 2))
        heading = np.column_stack([rays, np.ones(len(rays))]) @ self.rotation
        eye = self.eye
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (height_mm - eye[2]) / heading[:, 2]
            reach[~(reach > 0.0)] = np.nan
            return np.asarray(eye[:2] + reach[:, None] * heading[:, :2])

    def pixels(self, points: Array) -> Array:
        """Projects points of the world: (n, 3) mm -> (n, 2) pixels; NaN behind the camera."""
        seen = np.asarray(points, np.float64).reshape(-1, 3) @ self.rotation.T + self.translation
        with np.errstate(divide="ignore", invalid="ignore"):
            rays = seen[:, :2] / seen[:, 2:]
        rays[seen[:, 2] <= 0.0] = np.nan
        return self.lens.pixels(rays)

    def pixels_at(self, places: Array, height_mm: float = 0.0) -> Array:
        """Projects places on a level plane: (n, 2) mm -> (n, 2) pixels."""
        places = np.asarray(places, np.float64).reshape(-1, 2)
        return self.pixels(np.column_stack([places, np.full(len(places), height_mm)]))

    def moved(self, pose: Pose2) -> "View":
        """The same view in another world frame.

        `pose` is the pose of that frame in the present world frame: mm, mm, rad.
        """
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([pose[0], pose[1], 0.0])
        return View(self.lens, self.rotation @ turn, self.rotation @ shift + self.translation)


class Fit(NamedTuple):
    """The rigid motion of the plane that best maps one set of points to another, and the residual."""

    pose: Pose2  # x, y, theta: mm, mm, rad
    rms_mm: float  # root mean square of the residuals, over points
    scale: float  # size of the second set relative to the first, which the motion does not contain


def as_it_lies(print_mm: Array, from_below: bool) -> Array:
    """Converts points (n, 2) of a print, x right and y down, to the print's frame on the table.

    The y axis changes its sign, except for a print that lies face down and is seen from below.
    """
    return np.asarray(print_mm * (1.0, 1.0 if from_below else -1.0))


def placed(points: Array, pose: Pose2) -> Array:
    """Converts points (n, 2), mm, from the frame at `pose` to the frame in which `pose` is given."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + pose[:2])


def rigid_fit(points: Array, seen: Array) -> Fit:
    """Fits the motion that maps points (n, 2) to where they are seen, mm, by least squares.

    Source: Umeyama, IEEE PAMI 13 (1991). In the plane, the rotation is the angle of an inner product of
    complex vectors.
    """
    a, b = points @ (1.0, 1.0j), seen @ (1.0, 1.0j)
    middle, middle_seen = a.mean(), b.mean()
    a, b = a - middle, b - middle_seen
    product = np.vdot(a, b)
    turn = np.exp(1j * np.angle(product))
    shift = middle_seen - turn * middle
    rms = float(np.sqrt(np.mean(np.abs(b - turn * a) ** 2)))
    scale = float(np.abs(product) / np.vdot(a, a).real)
    return Fit((float(shift.real), float(shift.imag), float(np.angle(product))), rms, scale)
