"""Kernel conditional density estimation of a squeeze: final pose given initial pose (paper V).

    P(qf | qi) = sum_j w_j K_h2(qf, qf_j),   w_j ~ K_h1(qi, qi_j)        (eqs 6-8)

The sum runs over roll-outs j. Poses are in the hand frame, normalised to [x, y, rho theta], and the angle is
wrapped under the part's rotational order. A draw picks a roll-out at random by its weight, among those of the
400 nearest roll-outs whose weight exceeds e^-20 times the largest weight. Unlike in the paper, only parts
that the fingers touch are moved (`planner.mechanics.clearance`).
"""

import math
from collections import deque
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel
from planner.learned.neighbours import Grid, grid_of, keep_nearest, nearest_within
from planner.learned.rollouts import RollOuts
from planner.mechanics.clearance import STANDS_ON, TOUCHES, Jaws, classify_contact
from planner.work.scheduler import Threads

SPREAD = 40.0
"""Excess of a squared distance over the least, in squared bandwidths, above which a roll-out is ignored.

Its weight is then less than e^(-SPREAD / 2) times the largest.
"""
BANDWIDTH_MM = 0.5  # h1 and h2
NEIGHBOURS = 400  # number of nearest roll-outs considered
LOOK = 0.8  # Guess of the distance to the nearest roll-out, in spacings; it affects speed only
CHUNK = 1024


class Sampled(NamedTuple):
    """Final poses and widths that are drawn from the estimate, one for each initial pose."""

    poses: Array  # (n, 3) in the hand frame [mm, mm, rad]
    # (n,) opening at which the fingers stop; 0 if they miss the part, full if a finger comes down on it
    width_mm: Array
    source: IntArray  # (n,) the roll-out drawn; -1 if the fingers miss the part or come down on it


class Kcde(NamedTuple):
    """The fitted density: M roll-outs, ordered by grid cell."""

    grid: Grid  # normalised initial poses of the roll-outs
    initial: Array  # (M, 3) initial poses in the hand frame [mm, mm, rad]
    end: Array  # (M, 4) final poses and widths [mm, mm, rad, mm]
    source: IntArray  # (M,) original index of each roll-out
    outline: Array  # (N, 2) the part [mm]
    jaws: Jaws
    rho_mm: float  # millimetres that count like one radian

    @classmethod
    def fit(cls, rolled: RollOuts, outline: Array, jaws: Jaws, rho_mm: float, order: int) -> Self:
        """Fits the density to the roll-outs in which the fingers touch the part.

        The part has an outline (N, 2) [mm] of rotational order `order`; a radian counts as `rho_mm`
        millimetres.

        Raises:
            ValueError: no roll-out touches the part.
        """
        used = np.flatnonzero(classify_contact(outline, jaws, rolled.initial) == TOUCHES)
        if not len(used):
            problem = "no roll-out touches the part"
            raise ValueError(f"{problem}; roll out a region that the fingers reach")
        initial = rolled.initial[used]
        end = np.column_stack([rolled.final[used], rolled.width_mm[used]])
        grid = grid_of(initial * np.array([1.0, 1.0, rho_mm]), rho_mm * math.tau / order)
        row = grid.row
        return cls(grid, initial[row], end[row], used[row], outline, jaws, rho_mm)

    def sample(self, poses: Array, rng: np.random.Generator, workers: int = 1) -> Sampled:
        """Draws the final pose and width of a squeeze for each initial pose.

        `poses` (n, 3) are the initial poses of the parts in the hand frame [mm, mm, rad].
        The result does not depend on the number of workers (threads).
        """
        verdict = classify_contact(self.outline, self.jaws, poses)
        touched = np.flatnonzero(verdict == TOUCHES)
        n = len(touched)
        asked = np.ascontiguousarray(poses[touched])
        chance, noise = rng.random(n), rng.standard_normal((n, 3))
        end, source = np.zeros((n, 4)), np.zeros(n, np.int64)
        look = math.sqrt(SPREAD * BANDWIDTH_MM**2 + (LOOK * self.grid.spacing_mm) ** 2)

        def run(start: int) -> None:
            part = slice(start, start + CHUNK)
            _draw(self, look, asked[part], chance[part], noise[part], end[part], source[part])

        deque(Threads(workers).map(run, range(0, n, CHUNK)), maxlen=0)
        result = Sampled(
            np.array(poses, dtype=np.float64),
            np.where(verdict == STANDS_ON, self.jaws.opening_mm, 0.0),
            np.full(len(poses), -1, np.int64),
        )
        result.poses[touched] = end[:, :3]
        result.width_mm[touched] = np.clip(end[:, 3], 0.0, self.jaws.opening_mm)
        result.source[touched] = self.source[source]
        return result


@kernel
def _pick(squares: Array, count: int, chance: float) -> int:
    """Picks one of `count` roll-outs with a probability proportional to its kernel weight; returns its index.

    `squares` holds the squared distances [mm^2] of the roll-outs, and is overwritten with their cumulative
    weights. `chance` is a random number, uniform in [0, 1).
    """
    total, scale = 0.0, -0.5 / (BANDWIDTH_MM * BANDWIDTH_MM)
    for k in range(count):
        total += np.exp(scale * squares[k])
        squares[k] = total
    picked = 0
    while picked < count - 1 and squares[picked] <= chance * total:
        picked += 1
    return picked


@kernel
def _draw(
    model: Kcde,
    look: float,
    poses: Array,
    chance: Array,
    noise: Array,
    out: Array,
    source: IntArray,
) -> None:
    """Draws a final pose and width for each of `poses` (n, 3).

    Writes poses and widths into `out` (n, 4), and the indices of the drawn roll-outs into `source` (n,). The
    draws use `chance` (n,), uniform in [0, 1), and `noise` (n, 3), standard normal. The search for roll-outs
    begins within `look` [mm].
    """
    grid, initial, rho = model.grid, model.initial, model.rho_mm
    q, turn, spread = np.empty(3), grid.period / rho, SPREAD * BANDWIDTH_MM * BANDWIDTH_MM
    place, squares = np.empty(len(initial) + 1, np.int64), np.empty(len(initial) + 1)
    for i in range(poses.shape[0]):
        q[0], q[1], q[2] = poses[i, 0], poses[i, 1], (rho * poses[i, 2]) % grid.period
        result = nearest_within(grid, q, look, spread, place, squares)
        if result > NEIGHBOURS:
            keep_nearest(place, squares, result, NEIGHBOURS)
            result = NEIGHBOURS
        j = place[_pick(squares, result, chance[i])]
        out[i, 0] = model.end[j, 0] + BANDWIDTH_MM * noise[i, 0]
        out[i, 1] = model.end[j, 1] + BANDWIDTH_MM * noise[i, 1]
        turns = np.round((poses[i, 2] - initial[j, 2]) / turn)
        out[i, 2] = model.end[j, 2] + turns * turn + BANDWIDTH_MM * noise[i, 2] / rho
        out[i, 3] = model.end[j, 3]
        source[i] = j
