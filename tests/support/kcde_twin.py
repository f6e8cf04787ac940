"""Computes in numpy, slowly and simply, what the kernels of the learned model compute."""

import math

import numpy as np


def offsets(poses: np.ndarray, others: np.ndarray, rho: float, order: int) -> np.ndarray:
    """Returns the differences (n, m, 3) of poses (n, 3) from others (m, 3) [mm].

    The angle is wrapped, for a part with a symmetry of `order`, and multiplied by `rho`.
    """
    difference = poses[:, None] - others[None]
    period = math.tau / order
    turn = difference[..., 2] - period * np.round(difference[..., 2] / period)
    return np.stack([difference[..., 0], difference[..., 1], rho * turn], axis=-1)


def weights(
    poses: np.ndarray, initial: np.ndarray, rho: float, order: int, h1: float
) -> np.ndarray:
    """Returns the weights (n, m) of m roll-outs for n poses by eq. 8; each row has the sum 1.

    `initial` (m, 3) has the initial poses of the roll-outs, `h1` is the bandwidth [mm].
    """
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
