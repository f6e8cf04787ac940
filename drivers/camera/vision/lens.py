"""The lens: a pinhole with Brown and Conrady's distortion, the five-parameter model of OpenCV.

The centre of the first pixel is (0, 0), as in all of OpenCV.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.camera.vision.arrays import Array

ITERATIONS = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-12)
UNMOVED = np.zeros(3)


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsic parameters of a camera; projects rays to pixels and back."""

    width: int  # width of the picture, pixels
    height: int  # height of the picture, pixels
    focal: tuple[float, float]  # fx, fy, pixels
    centre: tuple[float, float]  # cx, cy, pixels
    distortion: tuple[float, float, float, float, float]  # k1, k2, p1, p2, k3

    @property
    def matrix(self) -> Array:
        """The camera matrix, (3, 3)."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def pixels(self, rays: Array) -> Array:
        """Projects rays: (n, 2) at depth one -> (n, 2) pixels."""
        solid = np.column_stack([rays, np.ones(len(rays))])
        seen, _ = cv2.projectPoints(solid, UNMOVED, UNMOVED, self.matrix, np.array(self.distortion))
        return np.asarray(seen, np.float64).reshape(-1, 2)

    def rays(self, pixels: Array) -> Array:
        """Computes the rays of pixels, (n, 2) -> (n, 2) at depth one; NaN for a pixel that no ray reaches."""
        pixels, bent = np.ascontiguousarray(pixels, np.float64), np.array(self.distortion)
        straight = cv2.undistortImagePoints(pixels, self.matrix, bent, None, ITERATIONS)
        rays = np.asarray((straight.reshape(-1, 2) - self.centre) / self.focal, np.float64)
        rays[~(np.abs(self.pixels(rays) - pixels).max(axis=1) < 1e-6)] = np.nan
        return rays
