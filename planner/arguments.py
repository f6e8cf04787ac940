"""Arguments of the planner's public functions: shape, finiteness and range, checked once before a kernel.

Kernels do not check: a wrong argument would make them read beyond their arrays, or never end. The
checks raise a `ValueError` that names the argument.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.arrays import Array, IntArray

FARTHEST = 1e6  # of a coordinate [mm] or an angle [rad], in magnitude
LONGEST_MM = 1e4  # way of a push
MOST_TURN = 2.0 * np.pi + 1e-9  # of a pusher [rad]
MOST = 10**9  # of anything counted


def rows(
    values: ArrayLike, name: str, *shape: int, least: float = -FARTHEST, most: float = FARTHEST
) -> Array:
    """Finite numbers (n, *shape) from `least` to `most`.

    Raises:
        ValueError: wrong shape, or a number that is not finite or out of range.
    """
    array = _array(values, name)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
        wanted = ", ".join(["n", *map(str, shape)]) + ("" if shape else ",")
        raise ValueError(f"{name} has shape {array.shape}; pass ({wanted})")
    return _within(array, name, least, most)


def row(values: ArrayLike, name: str, length: int) -> Array:
    """Finite numbers (length,).

    Raises:
        ValueError: as `rows`.
    """
    array = _array(values, name)
    if array.shape != (length,):
        raise ValueError(f"{name} has shape {array.shape}; pass ({length},)")
    return _within(array, name, -FARTHEST, FARTHEST)


def number(value: float, name: str, least: float, most: float) -> float:
    """A finite number from `least` to `most`.

    Raises:
        ValueError: not a finite number in that range.
    """
    array = _array(value, name)
    if array.shape != ():
        raise ValueError(f"{name} has shape {array.shape}; pass one number")
    return float(_within(array, name, least, most))


def indices(values: ArrayLike, name: str, size: int) -> IntArray:
    """Whole numbers (n,) from 0 to size - 1; negative indices are refused.

    Raises:
        ValueError: wrong shape, not whole numbers, or out of range.
    """
    array = np.asarray(values)
    if array.ndim != 1 or (array.size and not np.issubdtype(array.dtype, np.integer)):
        raise ValueError(
            f"{name} has shape {array.shape} of {array.dtype}; pass whole numbers (n,)"
        )
    if array.size and not (array.min() >= 0 and array.max() < size):
        beyond = array[(array < 0) | (array >= size)][0]
        raise ValueError(f"{name} holds {beyond}; there are 0 to {size - 1}")
    return array.astype(np.int64)


def count(value: int, name: str, least: int = 1, most: int = MOST) -> int:
    """A whole number from `least` to `most`.

    Raises:
        ValueError: not a whole number in that range.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and least <= value <= most):
        raise ValueError(f"{name} is {value!r}; pass a whole number from {least} to {most}")
    return int(value)


def same_length(**arrays: Sequence[Any] | NDArray[Any] | None) -> None:
    """Checks that arrays have the same number of rows; None is skipped.

    Raises:
        ValueError: two of them differ in length.
    """
    sizes = {name: len(array) for name, array in arrays.items() if array is not None}
    if len(set(sizes.values())) > 1:
        lengths = ", ".join(f"{size} {name}" for name, size in sizes.items())
        raise ValueError(f"there are {lengths}; pass as many of each")


def _array(values: ArrayLike, name: str) -> Array:
    if np.iscomplexobj(values):
        raise ValueError(f"{name} is complex; pass an array of real numbers")
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is no array of numbers: {error}") from None


def _within(array: Array, name: str, least: float, most: float) -> Array:
    # Negated, so that nan is refused.
    if array.size and not (least <= array.min() and array.max() <= most):
        wrong = array[~((array >= least) & (array <= most))].flat[0]
        raise ValueError(f"{name} holds {wrong:g}; pass finite numbers from {least:g} to {most:g}")
    return array
