"""Slow, simple counterparts of the kernels of the learned model: all roll-outs for all poses, in numpy."""

import math

import numpy as np


def offsets(poses: np.ndarray, others: np.ndarray, rho: float, order: int) -> np.ndarray:
    """Normalised differences (n, m, 3) of poses (n, 3) from others (m, 3), the angle wrapped."""
    difference = poses[:, None] - others[None]
    period = math.tau / order
    turn = difference[..., 2] - period * np.round(difference[..., 2] / period)
    return np.stack([difference[..., 0], difference[..., 1], rho * turn], axis=-1)


def weights(
    poses: np.ndarray, initial: np.ndarray, rho: float, order: int, h1: float
) -> np.ndarray:
    """Weights (n, m) of m roll-outs for n poses by eq. 8, each row of sum 1; `h1` is the bandwidth [mm]."""
    square = (offsets(poses, initial, rho, order) ** 2).sum(axis=-1)
    log_weight = -0.5 * square / h1**2
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)


def energy_distance(a: np.ndarray, b: np.ndarray, rho: float, order: int) -> float:
    """Energy distance of two samples of poses, by the distances of all pairs [mm]."""

    def points(poses: np.ndarray) -> np.ndarray:
        around = np.exp(1j * order * poses[:, 2]) * rho / order
        return np.column_stack([poses[:, :2], around.real, around.imag])

    def mean(p: np.ndarray, q: np.ndarray) -> float:
        return float(np.linalg.norm(p[:, None] - q[None], axis=-1).mean())

    first, second = points(a), points(b)
    return 2 * mean(first, second) - mean(first, first) - mean(second, second)
