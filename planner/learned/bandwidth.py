"""Bandwidths of the motion model, chosen by held-out conditional likelihood within limits.

A part of the roll-outs is set aside, the estimate (`planner.learned.kcde`) is made of the rest, and the mean
logarithm of its density at the outcomes set aside is made as large as it gets: over a logarithmic grid of h1
and h2, and then in finer steps about the best.

One h2 for all would be a poor choice. Where the fingers hold a part its outcome is exact in some coordinates
and scattered in others, and between the two lie three orders of magnitude. So h2 is *local*: a factor, chosen
as above, times the scatter of the roll-outs near by, coordinate by coordinate. On the rectangle (70 000
roll-outs) that raises the likelihood by 3.6 a roll-out, in natural logarithms.

Likelihood alone would blur too much: it judges the density at every single pose, which takes many
neighbours, while a belief is pushed forward as a whole, and averages over its particles by itself. The limits
`H1_MOST` and `H2_MOST` come from the energy distance between push-forwards (decision 0011).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel
from planner.learned.kcde import SPREAD, Kcde
from planner.learned.neighbours import Grid, keep_least, nearest_within, within

NEAR = 8
"""Roll-outs near by that scatter is judged from."""
ALIKE = 3
"""Of those, the ones that ended most alike: the others may have ended in another way altogether."""
LEAST_SCATTER_MM = 0.002
"""Less than a step of the simulator resolves."""
STEPS = (2.0**0.5, 2.0**0.25)
"""Ratios of neighbouring bandwidths in the refinements."""
H1_MOST = 0.125
"""Limit of h1, in spacings of the roll-outs."""
H2_MOST = 0.1
"""Limit of a local h2, as a factor of the scatter."""
OUTLIERS = 0.01
"""Share of a density that is flat: outcomes that no roll-out near by shows would otherwise decide alone."""


@kernel
def _end_offset(end: Array, initial: Array, slope: Array, j: int, start: Array, stop: Array, turn: float,
                rho: float, offset: Array) -> float:  # fmt: skip
    """Where an outcome `stop` lies from what roll-out j, carried over to `start`, says; (3,) in place [mm].

    Returns the squared length.
    """
    dt = start[2] - initial[j, 2]
    shift = np.round(dt / turn) * turn
    for row in range(3):
        offset[row] = stop[row] - end[j, row]
    offset[2] -= shift
    if len(slope):
        dx, dy, dt = start[0] - initial[j, 0], start[1] - initial[j, 1], dt - shift
        for row in range(3):
            offset[row] -= slope[j, row, 0] * dx + slope[j, row, 1] * dy + slope[j, row, 2] * dt
    offset[2] = rho * (offset[2] - np.round(offset[2] / turn) * turn)
    return float(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2])


@kernel
def _scatter(
    grid: Grid, initial: Array, end: Array, slope: Array, source: IntArray, rho: float, look: float,
    scatter: Array,
) -> None:  # fmt: skip
    """`local_scatter`; `scatter` (M, 3) in place."""
    n, turn = len(initial), grid.period / rho
    place, squares = np.empty(n + 1, np.int64), np.empty(n + 1)
    offsets, lengths, order = np.empty((NEAR + 1, 3)), np.empty(NEAR + 1), np.empty(NEAR + 1, np.int64)
    for j in range(n):
        reach = look
        found = within(grid, grid.points[j], reach, place, squares)
        while found < min(NEAR + 1, n):
            reach *= 1.5
            found = within(grid, grid.points[j], reach, place, squares)
        found = keep_least(place, squares, found, NEAR + 1)
        others = 0
        for k in range(found):
            i = place[k]
            if source[i] != source[j]:
                lengths[others] = _end_offset(
                    end, initial, slope, j, initial[i], end[i], turn, rho, offsets[others]
                )
                order[others] = others
                others += 1
        kept = keep_least(order, lengths, others, ALIKE)
        for row in range(3):
            total = 0.0
            for k in range(kept):
                total += offsets[order[k], row] ** 2
            scatter[j, row] = np.sqrt(total / max(kept, 1))


def local_scatter(model: Kcde) -> Array:
    """How far outcomes near by lie from each roll-out's, coordinate by coordinate.

    Args:
        model: an estimate of M roll-outs, of any bandwidth.

    Returns:
        (M, 3) root mean squares of x, y and rho theta over the `ALIKE` most alike of the `NEAR` nearest, at
        least `LEAST_SCATTER_MM` [mm], in the model's order.
    """
    scatter = np.zeros((len(model.initial), 3))
    _scatter(
        model.grid, model.initial, model.end, model.slope, model.source, model.rho_mm,
        1.5 * model.grid.spacing_mm, scatter,
    )  # fmt: skip
    return np.maximum(scatter, LEAST_SCATTER_MM)


class Likelihood(NamedTuple):
    """One pair of bandwidths.

    Attributes:
        h1_mm: bandwidth of initial poses.
        h2: bandwidth of final poses: a factor of `local_scatter`, or in mm where it is the same for all.
        mean_log: mean logarithm of the density at the outcomes set aside [1/mm^3].
    """

    h1_mm: float
    h2: float
    mean_log: float


class Bandwidths(NamedTuple):
    """The pair that was chosen, and what else was tried.

    Attributes:
        best: the pair of greatest likelihood.
        local: whether h2 is a factor of `local_scatter`.
        curve: every pair tried, in order.
    """

    best: Likelihood
    local: bool
    curve: list[Likelihood]

    def applied_to(self, model: Kcde) -> Kcde:
        """An estimate with these bandwidths."""
        scatter = local_scatter(model) if self.local else np.ones_like(model.scatter)
        return replace(model, h1_mm=self.best.h1_mm, scatter=self.best.h2 * scatter)


def choose(
    model: Kcde, initial: Array, final: Array, local: bool = True, h1_most_mm: float | None = None,
    h2_most: float | None = None,
) -> Bandwidths:  # fmt: skip
    """The bandwidths of greatest likelihood within limits.

    Args:
        model: an estimate made without the roll-outs set aside, of any bandwidth.
        initial: (m, 3) initial poses set aside, m >= 1, all touched by the fingers [mm, mm, rad].
        final: (m, 3) their outcomes.
        local: let h2 be a factor of `local_scatter`, not one length for all.
        h1_most_mm: greatest h1, `H1_MOST` spacings if None.
        h2_most: greatest h2, `H2_MOST` if None; a length in mm unless `local`.
    """
    scatter = local_scatter(model) if local else np.ones_like(model.scatter)
    h1_most = H1_MOST * model.grid.spacing_mm if h1_most_mm is None else h1_most_mm
    most = H2_MOST if h2_most is None else h2_most
    h1, h2 = h1_most * 2.0 ** np.arange(-3.0, 1.0), most * 4.0 ** np.arange(-5.0, 1.0)
    curve: list[Likelihood] = []
    best = _best_of(model, scatter, initial, final, h1, h2, curve)
    for step in STEPS:
        h1 = best.h1_mm * step ** np.array([-1.0, 0.0, 1.0])
        h2 = best.h2 * (step * step) ** np.array([-1.0, 0.0, 1.0])
        near = (h1[h1 <= h1_most * (1.0 + 1e-9)], h2[h2 <= most * (1.0 + 1e-9)])
        best = _best_of(model, scatter, initial, final, *near, curve)
    return Bandwidths(best, local, curve)


def log_likelihood(
    model: Kcde, scatter: Array, initial: Array, final: Array, h1_mm: Array, h2: Array
) -> Array:
    """Mean logarithm of the density of outcomes, for every pair of bandwidths [1/mm^3].

    Args:
        model: an estimate; its own bandwidths play no part.
        scatter: (M, 3) what h2 multiplies, for each of its roll-outs and coordinates [mm].
        initial: (m, 3) initial poses, m >= 1 [mm, mm, rad].
        final: (m, 3) their outcomes.
        h1_mm: (a,) bandwidths of initial poses.
        h2: (b,) bandwidths of final poses, in units of `scatter`.

    Returns:
        (a, b).
    """
    extent = np.ptp(model.grid.points[:, :2], axis=0)
    flat = OUTLIERS / max(float(np.prod(extent)) * model.grid.period, 1.0)
    table = np.zeros((len(h1_mm), len(h2)))
    _likelihoods(
        model.grid, model.initial, model.end, model.slope, scatter, model.rho_mm, model.grid.spacing_mm,
        np.ascontiguousarray(initial), np.ascontiguousarray(final), h1_mm, h2, flat, table,
    )  # fmt: skip
    return table


def _best_of(
    model: Kcde, scatter: Array, initial: Array, final: Array, h1: Array, h2: Array, curve: list[Likelihood]
) -> Likelihood:
    """The best pair so far; those tried are added to the curve."""
    table = log_likelihood(model, scatter, initial, final, h1, h2)
    curve += [
        Likelihood(float(a), float(b), float(table[i, j])) for i, a in enumerate(h1) for j, b in enumerate(h2)
    ]
    return max(curve, key=lambda tried: tried.mean_log)


@kernel
def _likelihoods(
    grid: Grid, initial: Array, end: Array, slope: Array, scatter: Array, rho: float, spacing: float,
    starts: Array, stops: Array, h1: Array, h2: Array, flat: float, table: Array,
) -> None:  # fmt: skip
    """`log_likelihood`; `table` (a, b) in place."""
    turn, widest = grid.period / rho, h1.max()
    place, squares = np.empty(len(initial) + 1, np.int64), np.empty(len(initial) + 1)
    q, offset, weight = np.empty(3), np.empty(3), np.zeros(len(h1))
    density = np.zeros((len(h1), len(h2)))
    look = np.sqrt(SPREAD * widest * widest + spacing * spacing)
    for i in range(starts.shape[0]):
        q[0], q[1], q[2] = starts[i, 0], starts[i, 1], (rho * starts[i, 2]) % grid.period
        found, _ = nearest_within(grid, q, look, SPREAD * widest * widest, place, squares)
        density[:] = 0.0
        weight[:] = 0.0
        for k in range(found):
            j = place[k]
            _end_offset(end, initial, slope, j, starts[i], stops[i], turn, rho, offset)
            square, volume = 0.0, (2.0 * math.pi) ** 1.5
            for row in range(3):
                square += (offset[row] / scatter[j, row]) ** 2
                volume *= scatter[j, row]
            for a in range(len(h1)):
                w = np.exp(-0.5 * squares[k] / (h1[a] * h1[a]))
                weight[a] += w
                for b in range(len(h2)):
                    density[a, b] += w * np.exp(-0.5 * square / (h2[b] * h2[b])) / (volume * h2[b] ** 3)
        for a in range(len(h1)):
            for b in range(len(h2)):
                table[a, b] += np.log((1.0 - OUTLIERS) * density[a, b] / weight[a] + flat) / len(starts)
