"""Checks the arguments of the planner's public functions: shape, finiteness and range.

Kernels do not check: a wrong argument would make them read beyond their arrays, or never end. Each check
returns the argument in its final type, or raises a `ValueError` that names the argument.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.arrays import Array, IntArray

FARTHEST = 1e6  # largest magnitude of a coordinate [mm] or an angle [rad]
LONGEST_MM = 1e4  # longest way of a push
MOST_TURN = 2.0 * np.pi + 1e-9  # largest turn of a pusher [rad]
MOST = 10**9  # largest number that counts something


def rows(
    values: ArrayLike, name: str, *shape: int, least: float = -FARTHEST, most: float = FARTHEST
) -> Array:
    """Checks that values are finite numbers (n, *shape) from `least` to `most`.

    Raises:
        ValueError: the shape is wrong, or a number is not finite or out of range.
    """
    array = _array(values, name)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
        wanted = ", ".join(["n", *map(str, shape)]) + ("" if shape else ",")
        raise ValueError(f"{name} has shape {array.shape}; pass ({wanted})")
    return _within(array, name, least, most)


def row(values: ArrayLike, name: str, length: int) -> Array:
    """Checks that values are finite numbers (length,), at most `FARTHEST` in magnitude.

    Raises:
        ValueError: see `rows`.
    """
    array = _array(values, name)
    if array.shape != (length,):
        raise ValueError(f"{name} has shape {array.shape}; pass ({length},)")
    return _within(array, name, -FARTHEST, FARTHEST)


def number(value: float, name: str, least: float, most: float) -> float:
    """Checks that a value is one finite number from `least` to `most`.

    Raises:
        ValueError: the value is not one number, not finite or out of range.
    """
    array = _array(value, name)
    if array.shape != ():
        raise ValueError(f"{name} has shape {array.shape}; pass one number")
    return float(_within(array, name, least, most))


def indices(values: ArrayLike, name: str, size: int) -> IntArray:
    """Checks that values are whole numbers (n,) from 0 to size - 1; refuses negative indices.

    Raises:
        ValueError: the shape is wrong, or a value is not a whole number or out of range.
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
    """Checks that a value is a whole number from `least` to `most`.

    Raises:
        ValueError: the value is not a whole number, or out of range.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and least <= value <= most):
        raise ValueError(f"{name} is {value!r}; pass a whole number from {least} to {most}")
    return int(value)


def same_length(**arrays: Sequence[Any] | NDArray[Any] | None) -> None:
    """Checks that arrays have the same number of rows; skips arguments that are None.

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
