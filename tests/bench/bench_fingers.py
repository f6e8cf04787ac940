"""Compares our solver with squeezes by three round fingers, and with pushes of a robot with two fingers.

    python tests/bench/bench_fingers.py --data FOLDER

FOLDER is condensed from the public toolbox of the paper's authors. It holds `three_fingers.csv`, squeezes
that the authors simulated, and `robot_runs/*.csv`, pushes that a real robot made.

The authors squeeze a hexagon whose limit surface is a quartic, and do not state its coefficients. Here they
are identified from every third squeeze and judged by the other squeezes; the quartic of a uniform pressure is
judged beside it. For a quartic, each step solves a sequence of LCPs, which should converge. Where two fingers
touch, the authors' sequence seems to end early (`cut_short`). The identified quartic is judged with sequences
that end early, and with sequences that converge.

Prints figures and writes `results/fingers.json`. Not part of `tools/check`.
"""

import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import harness
import numpy as np
from scipy.optimize import least_squares

from planner.arrays import Array
from planner.cli import tips
from planner.frames import wrap
from planner.kernel import inner_kernel
from planner.mechanics import limit_surface, quartic_fit
from planner.mechanics.boundary import Drive, directions
from planner.mechanics.contacts import place
from planner.mechanics.lcp import SOLVED
from planner.mechanics.push import Paths
from planner.mechanics.quartic import QuarticSurface
from planner.mechanics.simulator import Simulator
from planner.mechanics.step import StepWork, rotate_surface, solve
from planner.mechanics.stepping import Body, Scratch, find_contacts, scratch_of
from planner.mechanics.surface_step import local_matrix, solve_surface
from planner.part.outline import radius_of_gyration
from planner.part.pressure import Pressure, support

RESULTS = harness.Kept("fingers")
THREE = "three_fingers.csv"
NEAR_MM, NEAR_DEG = 0.3, 1.0  # of squeezes
MARGIN_MM = 0.1
# Step for 0, 1, 2 and 3 near contacts: so short that no event need end it.
STEPS_MM = (0.05, 0.01, 0.01, 0.001)
TRIANGLE_A = [[1.06868, 0.01242, -0.16074], [0.01242, 1.06166, -0.01284]]
TRIANGLE_A += [[-0.16074, -0.01284, 4.58574]]
FIT_EVERY = 3  # Every third squeeze is fitted
# Of the fit: scale of the loss, limit of an error, steps of the differences, evaluations with each step.
SCALE_MM, MOST_MM, STEPS, LOOKS = 0.1, 3.0, (0.05, 0.02, 0.005), 14
CUT = 5.0
"""Net force up to which a sequence of LCPs ends early, per mm of closing, in units of the quartic's scale."""

UNIFORM = Pressure("uniform", 20)

RUN_MM, RUN_DEG = 3.0, 3.0  # of the ends of pushes by a robot
TIP_MM, APART_MM = 2.5, 24.0
FRICTIONS = (0.2, 0.5, 0.95)  # The last is what this group took for such fingers
JUMP_MM, PAUSE_S = 10.0, 0.6  # between two readings: the hand went through the air
LEAST_READINGS = 30  # of a push
STILL_MM = 2.0  # Before the hand has gone so far, the part lies as at the start
OUTLINES = {
    "bigrect": np.array([[-25.5, -18.0], [25.5, -18.0], [25.5, 18.0], [-25.5, 18.0]]),
    # No outline is recorded: legs of 60 and 29 mm leave the fingers where they stand at the ends of pushes.
    "tri": np.array([[20.0, -29.0 / 3.0], [20.0, 58.0 / 3.0], [-40.0, -29.0 / 3.0]]),
}


class Tips(NamedTuple):
    """Three round finger tips that close towards the origin."""

    angle: float  # of the first one's place; the others follow at 120 and 240 degrees [rad]
    radius_mm: float
    mu: float
    ends_mm: tuple[float, float]  # how far from the origin they begin, and end


class Part(NamedTuple):
    """A part: its outline and its limit surface."""

    outline: Array  # (N, 2)
    rho_mm: float
    surface: Array  # as `planner.mechanics.surface.nominal`


class Push(NamedTuple):
    """One push that the robot made: the path of its hand, and where the part was before and after."""

    group: str  # pushes that ought to be alike
    outline: str
    hand: Array  # (k, 3) poses on its way [mm, mm, rad]
    start: Array  # (3,) of the part
    end: Array


@inner_kernel
def cut_short(
    surface: Array, c: float, s: float, mu: float, count: int, cut: float, work: StepWork
) -> bool:
    """Returns whether a step with a quartic ends after the first LCP of its sequence, as with the authors.

    The step ends if there are at least two contacts, and the sum of their forces in the first LCP is smaller
    than `cut`; `work` then holds the solution. The first LCP uses the quartic's matrix at a wrench of three
    equal components. This rule reproduces the recorded squeezes; the authors do not state it.
    """
    if count < 2 or cut == 0.0:
        return False
    work.F[:] = 1.0 / np.sqrt(3.0)
    local_matrix(surface, work.F, work.local)
    rotate_surface(work.local, c, s, work.A)
    if solve(mu, mu, count, work) != SOLVED:
        return False
    x, y = 0.0, 0.0
    for k in range(count):
        contact = work.contacts[k]
        x += contact.fn * contact.nx - contact.ft * contact.ny
        y += contact.fn * contact.ny + contact.ft * contact.nx
    return bool(np.hypot(x, y) < cut)


@inner_kernel
def close(body: Body, tips: Tips, cut: float, q: Array, scratch: Scratch) -> float:
    """Closes the tips until they hold the part; returns their distance from the origin [mm].

    The part is at the pose q (3,), which the call modifies. For a step of d mm, `cut_short` gets the limit
    d * `cut`.
    """
    work, boundary, away = scratch.work, scratch.work.boundary, tips.ends_mm[0]
    boundary.fingers, boundary.points, boundary.radius = 0, 3, tips.radius_mm
    work.step.F[0], work.step.F[1], work.step.F[2] = 0.0, 1.0, 0.0
    V, at = work.step.V, boundary.pusher
    while away > tips.ends_mm[1]:
        for k in range(3):
            angle = tips.angle + k * 2.0 * np.pi / 3.0
            at[k, 0], at[k, 1] = away * np.cos(angle), away * np.sin(angle)
        place(body.outline, q, scratch.points)
        find_contacts(q, MARGIN_MM, scratch)
        directions(work.step.contacts, work.count, body.rho, Drive(0.0, 0.0, 0.0, 0.0, 0.0))
        size = min(STEPS_MM[min(work.count, 3)], away - tips.ends_mm[1])
        for k in range(work.count):
            contact = work.step.contacts[k]
            x, y = -size * at[contact.side, 0] / away, -size * at[contact.side, 1] / away
            contact.un = x * contact.nx + y * contact.ny
            contact.ut = y * contact.nx - x * contact.ny
        c, s, count, mu = np.cos(q[2]), np.sin(q[2]), work.count, tips.mu
        solved = cut_short(body.surface, c, s, mu, count, cut * size, work.step)
        if not solved and solve_surface(body.surface, c, s, mu, mu, count, work.step) != SOLVED:
            break
        q[0], q[1], q[2], away = q[0] + V[0], q[1] + V[1], q[2] + V[2] / body.rho, away - size
    return away


def squeezed(part: Part, tips: Tips, poses: Array, cut: float = 0.0) -> Array:
    """Final poses (n, 3) of a part that the tips squeeze from each of the poses (n, 3).

    `cut` is that of `close`; if it is 0, all sequences of LCPs converge.
    """
    reach = float(np.hypot(*part.outline.T).max())
    body = Body(np.ascontiguousarray(part.outline.T), reach, part.surface, part.rho_mm)
    ends, scratch = np.array(poses), scratch_of(part.outline)
    for q in ends:
        close(body, tips, cut, q, scratch)
    return ends


def off(ends: Array, measured: Array) -> tuple[Array, Array]:
    """Distances (n,) [mm] and angles (n,) [deg] between computed and measured poses (n, 3)."""
    apart = ends - measured
    turn = np.abs(wrap(apart[:, 2]))
    return np.hypot(apart[:, 0], apart[:, 1]), np.degrees(turn)


def figures(ends: Array, measured: Array) -> dict[str, Any]:
    """The number of squeezes, the share that ends near the measured pose, and quantiles of the errors."""
    mm, deg = off(ends, measured)
    return {
        "squeezes": len(mm),
        "near": round(float(np.mean((mm < NEAR_MM) & (deg < NEAR_DEG))), 4),
        "p50_p90_p99_mm": np.quantile(mm, [0.5, 0.9, 0.99]).round(3).tolist(),
        "p50_p90_p99_deg": np.quantile(deg, [0.5, 0.9, 0.99]).round(2).tolist(),
    }


def three(folder: Path) -> dict[str, Any]:
    """Repeats the authors' squeezes by three fingers; returns the figures of each part and model."""
    rows = np.genfromtxt(folder / THREE, delimiter=",", names=True, dtype=None, encoding="utf-8")
    poses = {}
    for part in ("triangle", "hexagon"):
        ours = rows[rows["part"] == part]
        columns = ([1e3 * ours[f"x{k}"], 1e3 * ours[f"y{k}"], ours[f"th{k}"]] for k in (0, 1))
        poses[part] = [np.column_stack(each) for each in columns]
    corners = np.array([[0.0, 11.547], [-10.0, -5.7735], [10.0, -5.7735]])
    tips = Tips(math.pi / 2 + math.pi / 3, 2.0, 0.1, (27.094, 7.0))
    triangle = squeezed(Part(corners, 11.547, np.array(TRIANGLE_A)), tips, poses["triangle"][0])
    tips, angles = Tips(math.pi / 2, 2.0, 0.2, (47.0, 19.3)), np.arange(0.5, 6.5) * math.pi / 3
    part = Part(20.0 * np.column_stack([np.cos(angles), np.sin(angles)]), 20.0, np.zeros((6, 6)))
    start, end = poses["hexagon"]
    spread = quartic_fit.fit_pressure(*support(UNIFORM, part.outline), part.rho_mm)
    uniform = squeezed(part._replace(surface=spread.hessian_table()), tips, start)
    known = np.arange(len(start)) % FIT_EVERY == 0
    fitted = identified(part, spread, tips, start[known], end[known])
    part = part._replace(surface=fitted.hessian_table())
    cut, converged = (squeezed(part, tips, start[~known], limit) for limit in (CUT, 0.0))
    return {
        "triangle, ellipsoid": figures(triangle, poses["triangle"][1]),
        "hexagon, quartic of uniform pressure": figures(uniform, end),
        "hexagon, quartic identified, others": figures(cut, end[~known]),
        "hexagon, the same, sequence converged": figures(converged, end[~known]),
    }


def identified(
    part: Part, first: QuarticSurface, tips: Tips, start: Array, end: Array
) -> QuarticSurface:
    """Fits the quartic with which squeezes from the poses `start` (n, 3) end nearest to `end` (n, 3).

    Sequences of LCPs end early, as by `cut_short`. The loss is robust (soft L1).
    """
    first = replace(first, coefficients=first.coefficients / np.abs(first.coefficients).max())

    def surface(unknown: Array) -> QuarticSurface:
        return replace(first, coefficients=first.coefficients + 0.05 * (unknown - 1.0))

    def residuals(unknown: Array) -> Array:
        ends = squeezed(part._replace(surface=surface(unknown).hessian_table()), tips, start, CUT)
        apart = ends - end
        apart[:, 2] = part.rho_mm * wrap(apart[:, 2])
        return np.append(np.clip(apart, -MOST_MM, MOST_MM).ravel(), 0.003 * (unknown - 1.0))

    unknown = np.ones(15)  # shifted by 1, as in `planner.identification.motions`
    for step in STEPS:
        robust = {"loss": "soft_l1", "f_scale": SCALE_MM, "diff_step": step, "max_nfev": LOOKS}
        unknown = least_squares(residuals, unknown, **robust).x
    return surface(unknown)


def pushes(folder: Path) -> Iterator[Push]:
    """Reads the runs of the robot and yields their pushes.

    In an action of a run, the hand first jumps to where the push starts; the push is what follows.
    """
    for path in sorted((folder / "robot_runs").glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",")
        cuts = np.flatnonzero((np.diff(rows[:, 7]) != 0.0) | (np.diff(rows[:, 0]) > PAUSE_S)) + 1
        for number, action in enumerate(np.split(rows, cuts)):
            jumps = np.flatnonzero(np.hypot(*np.diff(action[:, 4:6], axis=0).T) > JUMP_MM)
            part, hand = np.split(action[np.append(-1, jumps)[-1] + 1 :, 1:7], 2, axis=1)
            seen = part.any(axis=1)  # by the cameras
            if len(hand) < LEAST_READINGS or not seen.any():
                continue
            still = seen & (np.hypot(*(hand[:, :2] - hand[0, :2]).T) < STILL_MM)
            begins = part[still if still.any() else np.argmax(seen)].reshape(-1, 3)
            start = np.median(begins, axis=0)
            name, hand[:, 2] = f"{path.name.split('__')[1]} {number}", np.unwrap(hand[:, 2])
            yield Push(name, name.partition("_")[0], hand, start, part[seen][-1])


def pushed(push: Push, part: Simulator, mu: float) -> Array:
    """Returns the final pose (3,) of the part, as computed at friction `mu`.

    The fingers push the part from each recorded pose of the hand to the next.
    """
    q, across = push.start.copy(), 0.5 * APART_MM * np.array([[0.0, 1.0], [0.0, -1.0]])
    hand = push.hand[np.append(True, np.diff(push.hand, axis=0).any(axis=1))]
    for number, (before, after) in enumerate(pairwise(hand)):
        into = turn(q[2])  # rows of coordinates into the part's frame
        centre, shift = (before[:2] - q[:2]) @ into, (after[:2] - before[:2]) @ into
        points = centre + across @ turn(q[2] - before[2])
        path = Paths(points[None], centre[None], np.array([after[2] - before[2]]), shift[None])
        if number == 0:  # The cameras may see the part in the fingers' way; the hand is where it is
            beside = tips.beside(path, TIP_MM, part.outline, Path(push.group)).paths
            q[:2] -= into @ (beside.centres[0] - centre)
            path = beside
        moved = part.push(path, part.nominal(1, mu), TIP_MM).moved[0]
        q += [*(into @ moved[:2]), moved[2]]
    return q


def turn(angle: float) -> Array:
    """The matrix (2, 2) of a rotation by an angle [rad].

    As `points @ turn(angle)` it turns points (n, 2) by `-angle`.
    """
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def runs(folder: Path) -> dict[str, Any]:
    """Computes the robot's pushes at several frictions; returns two shares of pushes for each friction.

    "near" is the share of pushes whose computed pose is near the measured pose. Pushes that ought to be alike
    form a group. "near or within spread" also counts a push if its computed pose is no farther from the mean
    measured pose of its group than the farthest measured pose of the group. The figures of each group are
    returned, too.
    """
    groups: defaultdict[str, list[Push]] = defaultdict(list)
    for push in pushes(folder):
        groups[push.group].append(push)
    parts = {name: simulator(outline) for name, outline in OUTLINES.items()}
    count = sum(map(len, groups.values()))
    result: dict[str, Any] = {"pushes": count}
    for mu in FRICTIONS:
        rows: list[dict[str, Any]] = []
        for name, group in sorted(groups.items()):
            ends = np.array([pushed(push, parts[push.outline], mu) for push in group])
            measured = np.array([push.end for push in group])
            mm, deg = off(ends, measured)
            near = (mm < RUN_MM) & (deg < RUN_DEG)
            middle = measured.mean(axis=0, keepdims=True)
            spread_mm, spread_deg = (column.max() for column in off(measured, middle))
            mm_off, deg_off = off(ends, middle)
            inside = near | ((mm_off <= spread_mm) & (deg_off <= spread_deg))
            rows.append(
                {
                    "group": name,
                    "pushes": len(group),
                    "near": int(near.sum()),
                    "near or within spread": int(inside.sum()),
                    "median_mm": round(float(np.median(mm)), 2),
                    "median_deg": round(float(np.median(deg)), 2),
                }
            )
        shares = {
            key: round(sum(row[key] for row in rows) / count, 4)
            for key in ("near", "near or within spread")
        }
        result[f"friction {mu}"] = shares | {"groups": rows}
    return result


def simulator(outline: Array) -> Simulator:
    """A simulator of a part with uniform pressure, for pushes alone: its jaws are only placeholders."""
    rho = radius_of_gyration(outline)
    surface = limit_surface.fit_ellipsoid(*support(UNIFORM, outline), rho)
    return Simulator(outline, surface, np.array([1e3, 20.0, 10.0, 0.5]), (0.1, 0.3), 20, workers=1)


def main() -> int:
    """Compares all squeezes and pushes, and writes the figures; returns the exit code."""
    parser = harness.parser(__doc__)
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER")
    options = parser.parse_args()
    if not (options.data / THREE).is_file():
        print(f"bench_fingers: {options.data} has no {THREE}; see --help", file=sys.stderr)
        return 3
    result = {"three": three(options.data), "two": runs(options.data)}
    harness.show(result)
    RESULTS.write(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
