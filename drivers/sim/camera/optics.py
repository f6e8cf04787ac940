"""The optics of the simulated camera: the ray of each point of the picture.

The measuring code projects and distorts by OpenCV, this module by formulas of its own. So a mistake in one of
them shows.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ITERATIONS = 15  # steps of the inverse distortion; the last moves a ray by less than 1e-7 pixels


@dataclass(frozen=True, eq=False)
class Optics:
    """A pinhole camera with lens distortion, above or below the table."""

    width: int  # width of the picture, pixels
    height: int  # height of the picture, pixels
    focal: float  # pixels, the same both ways
    centre: tuple[float, float]  # principal point, pixels; the centre of the first pixel is (0, 0)
    # k1, k2, p1, p2, k3 as OpenCV numbers them
    distortion: tuple[float, float, float, float, float]
    rotation: Array  # (3, 3) rotation from the world to the camera
    eye_mm: Array  # (3,) position of the camera; z < 0 below the table

    @cached_property
    def corner_rays(self) -> Array:
        """The world directions of the rays through all pixel corners, (height + 1, width + 1, 3)."""
        x = (np.arange(self.width + 1) - 0.5 - self.centre[0]) / self.focal
        y = (np.arange(self.height + 1) - 0.5 - self.centre[1]) / self.focal
        seen_x, seen_y = np.meshgrid(x, y)
        ray_x, ray_y = seen_x, seen_y
        for _ in range(ITERATIONS):
            radial, shift_x, shift_y = self._bend(ray_x, ray_y)
            ray_x, ray_y = (seen_x - shift_x) / radial, (seen_y - shift_y) / radial
        return np.stack([ray_x, ray_y, np.ones_like(ray_x)], axis=-1) @ self.rotation

    def moved(self, x_mm: float, y_mm: float) -> Self:
        """The same camera, shifted parallel to the table."""
        result = replace(self, eye_mm=self.eye_mm + np.array([x_mm, y_mm, 0.0]))
        # Its rays have the same directions, and take longer to compute than a picture.
        result.__dict__["corner_rays"] = self.corner_rays
        return result

    def project(self, points_mm: Array) -> Array:
        """Projects points of the world, (n, 3) mm -> (n, 2) pixels."""
        seen = (np.asarray(points_mm) - self.eye_mm) @ self.rotation.T
        x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        radial, shift_x, shift_y = self._bend(x, y)
        bent = np.stack([x * radial + shift_x, y * radial + shift_y], axis=1)
        return self.focal * bent + self.centre

    def _bend(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Distortion of rays (x, y, 1) by Brown and Conrady's model.

        Returns:
            Radial factor of both x and y, tangential shift of x, and tangential shift of y.
        """
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x**2 + y**2
        radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        shift_x = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2)
        return radial, shift_x, p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y


def webcam(
    eye_mm: tuple[float, float, float] = (0.0, 0.0, -600.0),
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    turn_deg: float = 0.0,
    size: tuple[int, int] = (1920, 1080),
) -> Optics:
    """Creates a camera with the lens of an ordinary wide-angle webcam (82 degrees across).

    Args:
        eye_mm: position; a camera below the table looks up, one above it looks down.
        tilt_deg: rotation about the camera's x and y.
        turn_deg: rotation about the optical axis.
        size: width and height of the picture; the angle of view stays the same.
    """
    looks_up = eye_mm[2] < 0.0
    # Seen from below with x to the right, the world's y points down in the picture; from above, up.
    facing = np.eye(3) if looks_up else np.diag([1.0, -1.0, -1.0])
    angles = np.diag(np.radians([*tilt_deg, turn_deg]))
    about_x, about_y, about_z = (np.asarray(cv2.Rodrigues(turn)[0], float) for turn in angles)
    width, height = size
    focal, centre = 1105.0 * width / 1920.0, (0.5 * width - 4.3, 0.5 * height + 6.1)
    distortion = (0.10, -0.19, 0.0006, -0.0004, 0.06)
    rotation = about_z @ about_y @ about_x @ facing
    return Optics(width, height, focal, centre, distortion, rotation, np.array(eye_mm, np.float64))
