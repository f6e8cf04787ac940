"""The metric that decides whether a part is located, and the mode ratio of a belief (paper VI.1, eq. 9).

The paper averages the poses and counts those near the average; the average of a belief of two modes lies
between them, near no particle. The *mode ratio* is the largest share of the belief within the goal of one
pose: it grows with progress, and that pose is the right prediction. Where the goal allows several modes, it
is the share within the goal of any of them.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.job.model import Job
from planner.kernel import inlined_kernel, inner_kernel, kernel
from planner.part.outline import radius_of_gyration

CANDIDATES = 48
REFINEMENTS = 4


class Mode(NamedTuple):
    """The pose with most particles of a belief within the goal; several poses where the goal allows them."""

    pose: Array  # (3,) [mm, mm, rad]
    ratio: float  # share of the belief within the goal of any of the poses
    others: Array = np.zeros((0, 3))  # (m, 3) further poses
    hypothesis: tuple[int, ...] = (0,)  # the hypothesis of each pose

    @property
    def state(self) -> Array:
        """(4,) the pose and the hypothesis."""
        return np.array([*self.pose, self.hypothesis[0]])


class Metric(NamedTuple):
    """Distance of a prediction from the truth, under the part's rotational symmetry.

    For kinds "pose" and "modes" d(q1, q2) = sqrt(dx^2 + dy^2) + rho dtheta in mm (eq. 9); for "tolerances"
    and "orientation" the largest deviation in units of its tolerance, so that the goal is 1. For "identity"
    it is 0.

    With several hypotheses a state has a fourth column, its hypothesis; a state of three columns belongs to
    the first hypothesis. The symmetry is that of the state's hypothesis. If the goal asks for the hypothesis,
    states of different hypotheses are infinitely far apart.
    """

    distance_mm: float  # the goal of d
    rho_mm: float  # millimetres that count like one radian
    order: int  # rotational order of the part
    kind: str = "pose"  # one of `runtime.table.KINDS`
    tolerance: tuple[float, float, float] = (1.0, 1.0, 1.0)  # bounds on x, y [mm] and theta [rad]
    modes: int = 1  # how many poses a prediction may name
    # rho [mm] and order of each hypothesis after the first
    further: tuple[tuple[float, int], ...] = ()
    identify: bool = True  # whether a prediction must name the right hypothesis

    @property
    def goal(self) -> float:
        """The distance below which a part is located."""
        return self.distance_mm if self.kind in ("pose", "modes") else 1.0

    def weights(self) -> Array:
        """Weights (h, 6) for the kernels, one row for each hypothesis.

        Columns: 1 to add deviations up or 0 to take the largest; 1 / goal of x, y and theta; the period of
        theta; 1 where a state of another hypothesis is never within the goal.
        """
        return np.array([self._row(*scale) for scale in ((self.rho_mm, self.order), *self.further)])

    def _row(self, rho_mm: float, order: int) -> list[float]:
        period, kind = 2.0 * math.pi / order, float(self.identify)
        if self.kind in ("pose", "modes"):
            length = 1.0 / self.distance_mm
            return [1.0, length, length, length * rho_mm, period, kind]
        x, y, theta = self.tolerance
        lengths = [1.0 / x, 1.0 / y] if self.kind == "tolerances" else [0.0, 0.0]
        return [0.0, *lengths, 0.0 if self.kind == "identity" else 1.0 / theta, period, kind]

    def between(self, states: Array, reference: Array) -> Array:
        """Distances of states (..., 3 or 4) to reference states, broadcast against them."""
        which, said = _hypothesis(states), _hypothesis(reference)
        added, x, y, theta, period, _ = np.moveaxis(self.weights()[which], -1, 0)
        dx = x * np.abs(states[..., 0] - reference[..., 0])
        dy = y * np.abs(states[..., 1] - reference[..., 1])
        off = states[..., 2] - reference[..., 2]
        turn = theta * np.abs(off - period * np.round(off / period))
        largest = np.maximum(np.maximum(dx, dy), turn)
        distance = self.goal * np.where(added > 0.0, np.hypot(dx, dy) + turn, largest)
        return np.asarray(np.where(self.identify & (which != said), np.inf, distance))

    def reached(self, states: Array, reference: Array) -> BoolArray:
        """Mask of the states that are within the goal of their reference states."""
        return np.asarray(self.between(states, reference) < self.goal)

    def explained(self, states: Array, mode: Mode) -> BoolArray:
        """Mask (n,) of the states (n, 3 or 4) within the goal of a mode, or of one of its further poses."""
        said = np.column_stack([np.vstack([mode.pose, mode.others]), mode.hypothesis])
        return np.asarray(self.reached(states[:, None], said).any(axis=1))

    def shares(self, beliefs: Sequence[Array], most: int) -> Array:
        """Shares (k, most) of the heaviest modes of k beliefs (n, 3 or 4): as `main_modes`, but faster."""
        shares, sizes = np.zeros((len(beliefs), most)), [len(states) for states in beliefs]
        stops = np.cumsum(sizes, dtype=np.int64)
        columns = np.zeros((4 if self.further else 3, int(stops[-1]) if beliefs else 0))
        for belief, stop in zip(beliefs, stops, strict=True):
            columns[: belief.shape[1], stop - len(belief) : stop] = belief.T
        mode_shares(columns, stops, self.weights(), shares)
        return shares

    def mode(self, states: Array) -> Mode:
        """The mode of a belief: the pose, or several if the goal allows, with most particles within the goal.

        Args:
            states: (n, 3 or 4) particles, n >= 1 [mm, mm, rad, hypothesis].
        """
        result = self.main_modes(states, self.modes)
        ratio = min(1.0, sum(mode.ratio for mode in result))
        others = np.array([mode.pose for mode in result[1:]]).reshape(-1, 3)
        return Mode(result[0].pose, ratio, others, tuple(mode.hypothesis[0] for mode in result))

    def main_modes(self, states: Array, most: int, least_share: float = 0.0) -> list[Mode]:
        """The heaviest modes, one after the other: each counts only particles outside those before it.

        Args:
            states: (n, 3 or 4) particles, n >= 1 [mm, mm, rad, hypothesis].
            most: how many at most.
            least_share: share below which a mode is left out, unless it is the first.

        Returns:
            Single modes, each with its share of all the particles.
        """
        weights, total, rest = self.weights(), len(states), states
        results: list[Mode] = []
        for number in range(most):
            if not len(rest) or (number and len(rest) < least_share * total):
                break
            columns, state = np.ascontiguousarray(rest.T), np.empty(states.shape[1])
            share = largest_mode(columns, len(rest), weights, state) * len(rest) / total
            if number and share < least_share:
                break
            results.append(Mode(state[:3], share, hypothesis=(int(_hypothesis(state)),)))
            if most > 1:
                rest = rest[~self.reached(rest, state)]
        return results


def _hypothesis(states: Array) -> IntArray:
    """The hypotheses (...,) of states (..., 3 or 4)."""
    which = states[..., 3] if states.shape[-1] > 3 else np.zeros(states.shape[:-1])
    return np.asarray(which, np.int64)


def metric_of(job: Job) -> Metric:
    """The metric of a job's goal."""
    goal, parts = job.goal, [alone.part for alone in job.alone]
    first, *others = [(radius_of_gyration(part.outline_mm), part.symmetry) for part in parts]
    tolerance = (*goal.tolerance_mm, math.radians(goal.tolerance_deg))
    modes = goal.modes if goal.kind == "modes" else 1
    named = goal.identify is not False
    return Metric(goal.distance_mm, *first, goal.kind, tolerance, modes, tuple(others), named)


@inlined_kernel
def off(columns: Array, i: int, centre: Array, weights: Array) -> tuple[float, float]:
    """Distance of state i from `centre`, in units of the goal, and the turn from `centre` to the state [rad].

    If the goal asks for the hypothesis, a state of another hypothesis than `centre` is infinitely far away.
    """
    which = 0
    if columns.shape[0] > 3:
        if weights[0, 5] > 0.0 and columns[3, i] != centre[3]:
            return np.inf, 0.0
        which = int(columns[3, i])
    turn, period = columns[2, i] - centre[2], weights[which, 4]
    turn -= period * np.round(turn / period)
    x = weights[which, 1] * (columns[0, i] - centre[0])
    y = weights[which, 2] * (columns[1, i] - centre[1])
    angle = weights[which, 3] * abs(turn)
    if weights[which, 0] > 0.0:
        return np.sqrt(x * x + y * y) + angle, turn
    return max(abs(x), abs(y), angle), turn


@inner_kernel
def within(
    columns: Array, low: int, high: int, centre: Array, weights: Array, inside: BoolArray
) -> int:
    """Marks the states with indices `low` to `high` - 1 that are within the goal of `centre`; counts them.

    The states are columns of a (3 or 4, n) array, so that the loop is vectorised for poses of one part.

    Args:
        columns: x, y [mm], theta [rad] and maybe the hypothesis of n states.
        low: index of the first state.
        high: one past the index of the last state.
        centre: (3 or 4,) the central state; turns are taken modulo the symmetry of each state's part.
        weights: (h, 6) weights of the metric, one row for each hypothesis.
        inside: (n,) output; the entries from `low` to `high` - 1 are written.

    Returns:
        The number of marked states.
    """
    count = 0
    if columns.shape[0] > 3 or weights[0, 0] == 0.0:
        for i in range(low, high):
            inside[i] = off(columns, i, centre, weights)[0] < 1.0
            count += int(inside[i])
        return count
    x, y, theta, period = weights[0, 1], weights[0, 2], weights[0, 3], weights[0, 4]
    for i in range(low, high):
        dx, dy = x * (columns[0, i] - centre[0]), y * (columns[1, i] - centre[1])
        turn = columns[2, i] - centre[2]
        room = 1.0 - theta * abs(turn - period * np.round(turn / period))
        inside[i] = (room > 0.0) & (dx * dx + dy * dy < room * room)
        count += int(inside[i])
    return count


@inner_kernel
def inliers(
    columns: Array,
    low: int,
    high: int,
    centre: Array,
    weights: Array,
    inside: BoolArray,
    mean: Array,
) -> int:
    """Marks and counts states as `within` does, and writes the mean of the marked states into `mean`.

    The mean is taken of the deviations from the centre, so that turns count modulo the symmetry.
    """
    count = within(columns, low, high, centre, weights, inside)
    mean[:] = 0.0
    for i in range(low, high):
        if inside[i]:
            mean[0] += columns[0, i] - centre[0]
            mean[1] += columns[1, i] - centre[1]
            mean[2] += off(columns, i, centre, weights)[1]
    for j in range(3):
        mean[j] = centre[j] + mean[j] / max(count, 1)
    if columns.shape[0] > 3:
        mean[3] = centre[3]
    return count


@kernel
def largest_mode(columns: Array, n: int, weights: Array, state: Array) -> float:
    """Share of the first n states within the goal of the best pose that mean shift reaches.

    Starts from states spread evenly through the belief; the better ones climb to the mean of the states
    within the goal (mean shift with a flat kernel).

    Args:
        columns: (m, N) the states [mm, mm, rad, and maybe hypothesis], see `within`.
        n: number of states that count, at least 1.
        weights: (h, 6) weights of the metric.
        state: (m,) receives the best pose.

    Returns:
        The share, 0 to 1.
    """
    stride, best = max(1, n // CANDIDATES), -1
    centre, mean = np.empty(columns.shape[0]), np.empty(columns.shape[0])
    inside = np.empty(n, np.bool_)
    for start in range(0, n, stride):
        centre[:] = columns[:, start]
        if 2 * within(columns, 0, n, centre, weights, inside) < best:
            continue
        last = 0
        for _ in range(REFINEMENTS + 1):
            count = inliers(columns, 0, n, centre, weights, inside, mean)
            if count > best:
                best = count
                state[:] = centre
            if count < last:
                break
            last = count
            centre[:] = mean
        if best == n:
            break
    # Among equals the mean is the better prediction.
    inliers(columns, 0, n, state, weights, inside, mean)
    for _ in range(REFINEMENTS):
        centre[:] = mean
        count = inliers(columns, 0, n, centre, weights, inside, mean)
        if count < best:
            break
        best = count
        state[:] = centre
    return float(best / n)


@kernel
def mode_shares(columns: Array, stops: IntArray, weights: Array, shares: Array) -> None:
    """Fills in the `shares` (k, most) of the heaviest modes of k beliefs.

    The states of all beliefs stand in the columns (m, n) one after the other; `stops` (k,) are their ends.
    """
    rest, inside = np.empty_like(columns), np.empty(columns.shape[1], np.bool_)
    state, start = np.empty(columns.shape[0]), 0
    for k in range(len(stops)):
        size = left = stops[k] - start
        rest[:, :size] = columns[:, start : stops[k]]
        for j in range(shares.shape[1]):
            if left == 0:
                break
            shares[k, j] = largest_mode(rest, left, weights, state) * left / size
            kept = 0
            within(rest, 0, left, state, weights, inside)
            for i in range(left):
                if not inside[i]:
                    rest[:, kept] = rest[:, i]
                    kept += 1
            left = kept
        start = stops[k]
