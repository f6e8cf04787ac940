"""The lens: a pinhole with Brown and Conrady's distortion, the five-parameter model of OpenCV.

With (x, y) a ray at depth one and r^2 = x^2 + y^2 the ray is seen where

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

and pixel (fx x' + cx, fy y' + cy). The centre of the first pixel is (0, 0), as in all of OpenCV.
"""

from dataclasses import dataclass

import numpy as np

from drivers.camera.vision.arrays import Array

NEWTON_STEPS = 8


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsic parameters.

    Attributes:
        width: of the picture, pixels.
        height: of the picture, pixels.
        focal: fx, fy, pixels.
        centre: cx, cy, pixels.
        distortion: k1, k2, p1, p2, k3.
    """

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, float, float, float, float]

    @property
    def matrix(self) -> Array:
        """The camera matrix, (3, 3)."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def parameters(self) -> Array:
        """All nine: fx, fy, cx, cy, k1, k2, p1, p2, k3."""
        return np.array([*self.focal, *self.centre, *self.distortion])

    def with_parameters(self, values: Array) -> "Lens":
        """The same sensor behind another lens, in the order of `parameters`."""
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = map(float, values)
        return Lens(self.width, self.height, (fx, fy), (cx, cy), (k1, k2, p1, p2, k3))

    def pixels(self, rays: Array) -> Array:
        """Where rays are seen: (n, 2) at depth one -> (n, 2) pixels."""
        return np.asarray(_distorted(rays, self.distortion) * self.focal + self.centre)

    def rays(self, pixels: Array) -> Array:
        """The rays seen at pixels, (n, 2) -> (n, 2) at depth one: Newton's method on the distortion.

        A pixel that no ray reaches (far outside of a picture) comes out as NaN.
        """
        wanted = (np.asarray(pixels, np.float64) - self.centre) / self.focal
        rays = wanted.copy()
        for _ in range(NEWTON_STEPS):
            wrong = _distorted(rays, self.distortion) - wanted
            xx, xy, yy = _slopes(rays, self.distortion)
            scale = xx * yy - xy * xy
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                rays[:, 0] -= (yy * wrong[:, 0] - xy * wrong[:, 1]) / scale
                rays[:, 1] -= (xx * wrong[:, 1] - xy * wrong[:, 0]) / scale
        with np.errstate(invalid="ignore", over="ignore"):
            missed = ~(np.abs(_distorted(rays, self.distortion) - wanted).max(axis=1) < 1e-9)
        rays[missed] = np.nan
        return rays


def _distorted(rays: Array, distortion: tuple[float, ...]) -> Array:
    k1, k2, p1, p2, k3 = distortion
    x, y = rays[:, 0], rays[:, 1]
    with np.errstate(invalid="ignore", over="ignore"):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )


def _slopes(rays: Array, distortion: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """The distortion's Jacobian, which is symmetric: dx'/dx, dx'/dy = dy'/dx, dy'/dy."""
    k1, k2, p1, p2, k3 = distortion
    x, y = rays[:, 0], rays[:, 1]
    with np.errstate(invalid="ignore", over="ignore"):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        bend = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # d radial / d(r^2), doubled
        xx = radial + bend * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        xy = bend * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + bend * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return xx, xy, yy
