"""Array types for annotations, and selection of rows from tuples of arrays. Docstrings state the shapes."""

from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

Record = TypeVar("Record", bound=tuple[Any, ...])


def take(record: Record, rows: IntArray | BoolArray | slice) -> Record:
    """Returns a named tuple with the given rows of its arrays, also in nested tuples; None stays None."""
    chosen: list[Any] = []
    for values in record:
        if isinstance(values, tuple):
            chosen.append(take(values, rows))
        else:
            chosen.append(None if values is None else values[rows])
    return type(record)(*chosen)
