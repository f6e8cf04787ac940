"""A camera above or below a table, and what it sees on the table's plane.

The world's z axis points up and the table is at z = 0. A tag is measured by cutting its corners' rays with
the plane it is known to lie in: a free pose of six parameters would trade depth for tilt, and be off by
millimetres.

Whatever lies face down is seen from below, through the table, and handedness is settled in one place,
`as_it_lies`: print is described as one reads it, x to the right and y down.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.camera.vision.arrays import Array
from drivers.camera.vision.lens import Lens


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A lens at a place: p_camera = rotation p_world + translation.

    Attributes:
        lens: the lens.
        rotation: (3, 3).
        translation: (3,) mm.
    """

    lens: Lens
    rotation: Array
    translation: Array

    @property
    def eye(self) -> Array:
        """Where the camera is in the world, (3,) mm."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def from_below(self) -> bool:
        """Whether it looks up through the table."""
        return bool(self.eye[2] < 0.0)

    def on_plane(self, pixels: Array, height_mm: float = 0.0) -> Array:
        """Where the rays of pixels meet a level plane.

        Args:
            pixels: (n, 2).
            height_mm: of the plane above the table.

        Returns:
            (n, 2) world x and y, mm; NaN for a ray that never meets it.
        """
        rays = self.lens.rays(np.asarray(pixels, np.float64).reshape(-1, 2))
        heading = np.column_stack([rays, np.ones(len(rays))]) @ self.rotation
        eye = self.eye
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (height_mm - eye[2]) / heading[:, 2]
            reach[~(reach > 0.0)] = np.nan
            return np.asarray(eye[:2] + reach[:, None] * heading[:, :2])

    def pixels(self, points: Array) -> Array:
        """Where points of the world are seen: (n, 3) mm -> (n, 2); NaN behind the camera."""
        seen = np.asarray(points, np.float64).reshape(-1, 3) @ self.rotation.T + self.translation
        with np.errstate(divide="ignore", invalid="ignore"):
            rays = seen[:, :2] / seen[:, 2:]
        rays[seen[:, 2] <= 0.0] = np.nan
        return self.lens.pixels(rays)

    def pixels_at(self, places: Array, height_mm: float = 0.0) -> Array:
        """Where places on a level plane are seen: (n, 2) mm -> (n, 2)."""
        places = np.asarray(places, np.float64).reshape(-1, 2)
        return self.pixels(np.column_stack([places, np.full(len(places), height_mm)]))

    def moved(self, pose: tuple[float, float, float]) -> "View":
        """The same view in another world frame, whose pose (mm, mm, rad) in the present one is given."""
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([pose[0], pose[1], 0.0])
        return View(self.lens, self.rotation @ turn, self.rotation @ shift + self.translation)


class Fit(NamedTuple):
    """A rigid motion of the plane that takes one set of points to another.

    Attributes:
        pose: x, y, theta: mm, mm, rad.
        rms_mm: root mean square of what is left, over points.
        scale: the size at which the points would fit best; 1 = the size they should have.
    """

    pose: tuple[float, float, float]
    rms_mm: float
    scale: float


def as_it_lies(print_mm: Array, from_below: bool) -> Array:
    """Points of a print as one reads it (x right, y down) in its own frame as it lies on the table.

    Print that is read from above turns its y axis over; print that lies face down is turned over once more.
    """
    return np.asarray(print_mm * (1.0, 1.0 if from_below else -1.0))


def rigid_fit(points: Array, seen: Array) -> Fit:
    """The rotation and shift that take points to where they are seen, by least squares.

    Args:
        points: (n, 2) mm, n >= 2.
        seen: (n, 2) mm.

    Source: Umeyama, IEEE PAMI 13 (1991), in the plane, where it is an arc tangent.
    """
    middle, middle_seen = points.mean(axis=0), seen.mean(axis=0)
    a, b = points - middle, seen - middle_seen
    along = float(np.sum(a * b))
    across = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    theta = float(np.arctan2(across, along))
    c, s = np.cos(theta), np.sin(theta)
    turn = np.array([[c, -s], [s, c]])
    x, y = middle_seen - turn @ middle
    left = b - a @ turn.T
    rms = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    scale = float(np.hypot(along, across) / np.sum(a * a))
    return Fit((float(x), float(y), theta), rms, scale)


def compose(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    """The world's view of pose b, which is given in the frame of pose a."""
    c, s = float(np.cos(a[2])), float(np.sin(a[2]))
    turn = float(np.remainder(a[2] + b[2] + np.pi, 2.0 * np.pi) - np.pi)
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], turn)


def inverse(a: tuple[float, float, float]) -> tuple[float, float, float]:
    """The pose of the world in the frame of pose a."""
    c, s = float(np.cos(a[2])), float(np.sin(a[2]))
    return (-c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2])
