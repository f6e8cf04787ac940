"""Neighbour search among training points by the cells of a grid.

Poses are normalised to [x, y, rho theta] in mm (paper V.A); the last coordinate is wrapped under the part's
rotational order. The cells along this coordinate are stored next to each other, so that a search scans few
rows.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel

POINTS_PER_CELL = 2.0  # Mean number of points
LARGEST_GRID = 4_000_000  # Largest number of cells; more points get fuller cells


class Grid(NamedTuple):
    """Training points, sorted into the cells of a grid."""

    points: (
        Array  # (N, 3) normalised, in the order of the cells, last coordinate in [0, period) [mm]
    )
    row: IntArray  # (N,) original row of each point
    first: IntArray  # (cells + 1,) index of the first point of each cell, then N
    corner: Array  # (2,) least x and y of the grid [mm]
    size: Array  # (3,) sides of a cell [mm]
    shape: IntArray  # (3,) number of cells along each axis
    period: float  # period of the last coordinate [mm]

    @property
    def spacing_mm(self) -> float:
        """Typical distance of neighbours: the side of a cube that holds one point."""
        return float((np.prod(self.size) * self.shape.prod() / len(self.points)) ** (1.0 / 3.0))


def grid_of(points: Array, period: float) -> Grid:
    """Sorts normalised points (N, 3), N >= 1, into a grid; `period` is that of the last coordinate [mm]."""
    wrapped = np.array(points, dtype=np.float64)
    wrapped[:, 2] = wrap_up(wrapped[:, 2], period)
    corner = wrapped[:, :2].min(axis=0)
    extent = np.append(wrapped[:, :2].max(axis=0) - corner, period)
    cells = min(max(len(points) / POINTS_PER_CELL, 1.0), LARGEST_GRID)
    # A disc fills pi/4 of its square; degenerate extents get one cell.
    side = (np.prod(np.maximum(extent, 1e-3)) / cells) ** (1.0 / 3.0)
    shape = np.maximum(np.ceil(extent / side), 1).astype(np.int64)
    size = np.maximum(extent, 1e-3) / shape
    at = np.minimum(((wrapped - np.append(corner, 0.0)) / size).astype(np.int64), shape - 1)
    cell = (at[:, 0] * shape[1] + at[:, 1]) * shape[2] + at[:, 2]
    row = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[row], np.arange(shape.prod() + 1))
    return Grid(wrapped[row], row, first, corner, size, shape, float(period))


def wrap_up(coordinate: Array, period: float) -> Array:
    """Coordinates reduced to [0, period)."""
    wrapped = np.mod(coordinate, period)  # a tiny negative one rounds up to the period itself
    return np.asarray(np.where(wrapped >= period, 0.0, wrapped))


@kernel
def _gap(coordinate: float, low: float, size: float) -> float:
    """Distance of a coordinate from the interval [low, low + size]; 0 within the interval."""
    return max(low - coordinate, coordinate - low - size, 0.0)


@kernel
def _scan(
    grid: Grid,
    start: int,
    stop: int,
    q: Array,
    square: float,
    place: IntArray,
    squares: Array,
    count: int,
) -> int:
    """Adds to `place` those points from start to stop - 1 that lie within sqrt(square) [mm] of q (3,).

    `squares` receives their squared distances. Before the call both have `count` entries.

    Returns:
        The new count.
    """
    points, period = grid.points, grid.period
    for k in range(start, stop):
        dx, dy, dz = points[k, 0] - q[0], points[k, 1] - q[1], abs(points[k, 2] - q[2])
        dz = min(dz, period - dz)
        s = dx * dx + dy * dy + dz * dz
        # Written always and kept if near: a branch here would be mispredicted half the time.
        place[count] = k
        squares[count] = s
        count += s <= square
    return count


@kernel
def within(grid: Grid, q: Array, reach: float, place: IntArray, squares: Array) -> int:
    """Finds the points within `reach` [mm] of a normalised pose q (3,), its last coordinate in [0, period).

    Returns their number; `place` and `squares` (N + 1,) receive their indices in the grid, in order, and
    their squared distances [mm^2].
    """
    nx, ny, nz = grid.shape
    sx, sy, sz = grid.size
    x, y, z = q[0] - grid.corner[0], q[1] - grid.corner[1], q[2]
    square, result = reach * reach, 0
    x_first = int(max(np.floor((x - reach) / sx), 0))
    x_last = int(min(np.floor((x + reach) / sx), nx - 1))
    y_first = int(max(np.floor((y - reach) / sy), 0))
    y_last = int(min(np.floor((y + reach) / sy), ny - 1))
    for i in range(x_first, x_last + 1):
        gap_x = _gap(x, i * sx, sx)
        for j in range(y_first, y_last + 1):
            gap_y = _gap(y, j * sy, sy)
            left = square - gap_x * gap_x - gap_y * gap_y
            if left < 0.0:
                continue
            half = np.sqrt(left)
            low, high = int(np.floor((z - half) / sz)), int(np.floor((z + half) / sz))
            first = grid.first[(i * ny + j) * nz :]
            if high - low + 1 >= nz:
                low, high = 0, nz - 1
            elif low < 0 or high >= nz:  # the row goes on at its other end
                low, stop = (low + nz) % nz, first[high % nz + 1]
                result = _scan(grid, first[0], stop, q, square, place, squares, result)
                high = nz - 1
            start, stop = first[low], first[high + 1]
            result = _scan(grid, start, stop, q, square, place, squares, result)
    return result


@kernel
def nearest_within(
    grid: Grid, q: Array, start: float, spread: float, place: IntArray, squares: Array
) -> int:
    """Finds the points whose squared distance exceeds the nearest point's by at most `spread` [mm^2].

    Searches within `start` [mm] first: a good guess saves a second search. Returns their number, at least
    1; `place` and `squares` (N + 1,) receive their indices in the grid and the excess of each squared
    distance over the least.
    """
    reach, result = start, 0
    while True:
        result = within(grid, q, reach, place, squares)
        if result > 0:
            break
        reach *= 2.0
    least = squares[:result].min()
    # Slightly more than needed, lest rounding lose the nearest point itself.
    if least + spread > reach * reach:
        result = within(grid, q, np.sqrt(least + spread) * (1.0 + 1e-12), place, squares)
    kept = 0
    for k in range(result):
        excess = squares[k] - least
        if excess <= spread:
            place[kept], squares[kept] = place[k], max(excess, 0.0)
            kept += 1
    return kept


@kernel
def keep_nearest(place: IntArray, squares: Array, count: int, most: int) -> None:
    """Of `count` points, moves the nearest to the front of both arrays, in their former order.

    `most` is the number of points to move. Of points at equal distance the first are moved.
    """
    farthest = np.partition(squares[:count], most - 1)[most - 1]
    ties = most - np.sum(squares[:count] < farthest)
    kept = 0
    for k in range(count):
        tie = squares[k] == farthest and ties > 0
        if tie or squares[k] < farthest:
            place[kept], squares[kept] = place[k], squares[k]
            kept += 1
            ties -= tie
