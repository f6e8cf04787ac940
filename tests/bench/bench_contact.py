"""Measures how well our simulator and that of the paper's authors predict recorded pushes by a round tip.

    python tests/bench/bench_contact.py --data FOLDER

FOLDER holds three files, in m and rad, condensed from MIT's planar push data set (Yu, Bauza, Fazeli and
Rodriguez 2016, arXiv 1604.04038). `outlines.csv` has the columns shape, x and y. `pushes.csv` holds the
pushes and, in the columns `ell_*` and `quartic_*`, the ends that the authors' simulator predicts.
`wrench_twist.csv` holds pairs of wrench and twist about the origin of the poses. Only pushes of the set
`held20` are judged; neither simulator was fitted to them.

Prints figures and writes `results/contact.json`. Not part of `tools/check`.
"""

import csv
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import harness
import numpy as np
import shapely
from problems import random_poses
from programs import ROOT

from planner.arrays import Array, BoolArray
from planner.cli import pushes as stated
from planner.cli import tips
from planner.frames import wrap
from planner.identification import identify
from planner.identification.pushes import Pairs
from planner.job import model as job_file
from planner.job.drafts import FINGERS, Answers, draft
from planner.job.model import Job
from planner.mechanics import limit_surface
from planner.mechanics.push import Paths
from planner.mechanics.simulator import Simulator
from planner.mechanics.surface import MIDDLE
from planner.part.importers.file import Imported
from planner.part.outline import canonical, radius_of_gyration, simplified
from planner.part.pressure import Pressure, support

RESULTS = harness.Kept("contact")
FILES = ("outlines.csv", "pushes.csv", "wrench_twist.csv")
RADIUS_MM = 4.75
NEAR_MM, NEAR_DEG = 3.0, 5.0
FRICTIONS = (0.15, 0.175, 0.2, 0.225, 0.25, 0.3)
SURFACES = ("abs", "plywood")
DRAWS, EVERY = 200, 5  # draws of every fifth push, for intervals
SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of the draws, in central intervals
MODELS = ("uniform, friction .25", "authors' ellipsoid", "authors' quartic")
MODELS += ("new job", "from own pairs")
SQUARE = np.array([[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]])  # passes the jaws
UNIFORM = {"kind": "uniform", "limit_surface": "ellipsoid"}
RIM = {"kind": "boundary", "limit_surface": "ellipsoid"}
LOADS = {"rim": RIM, "area": UNIFORM, "quartic": {**RIM, "limit_surface": "quartic"}}
JOBS = sorted((ROOT / "trees").glob("*/job.toml"))
SQUEEZES = 1000  # of each part
APART_MM, APART_DEG = 1.0, 3.0
DRAWN_MM = 0.1  # Tolerance of outlines that are kept to be drawn


class Recorded(NamedTuple):
    """Pushes of one shape on one surface [mm], in the frame of the part's centroid at the start."""

    shape: str
    surface: str
    outline: Array  # (N, 2)
    origin: Array  # (2,) of the data's poses
    paths: Paths  # of tips that start beside the part
    overlap_mm: Array  # (n,) as recorded, negative where a tip does not touch yet
    moved: Array  # (n, 3) measured displacement of the centroid
    authors: dict[str, Array]  # (n, 3) the same by the authors' models


class Errors(NamedTuple):
    """Distances and angles between predicted and measured ends of pushes.

    The distance is that of the part's point at the origin of the data's poses.
    """

    mm: Array  # (n,)
    deg: Array

    @property
    def near(self) -> BoolArray:
        """Mask (n,) of the pushes whose errors are below `NEAR_MM` and `NEAR_DEG`."""
        return np.asarray((self.mm < NEAR_MM) & (self.deg < NEAR_DEG))


def read(path: Path) -> list[dict[str, str]]:
    """The lines of a CSV file, each as values by column."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def outlines(folder: Path) -> dict[str, Array]:
    """Reads the outlines (N, 2) of all shapes, by shape, in the frame of the data's poses [mm]."""
    points: dict[str, list[list[float]]] = {}
    for row in read(folder / "outlines.csv"):
        points.setdefault(row["shape"], []).append([1e3 * float(row["x"]), 1e3 * float(row["y"])])
    return {shape: np.array(rows) for shape, rows in points.items()}


def recorded(folder: Path, kind: str) -> Iterator[Recorded]:
    """Reads the pushes of the set `kind` and yields them by shape and surface."""
    rows = [row for row in read(folder / "pushes.csv") if row["set"] == kind]
    for shape, drawn in outlines(folder).items():
        centroid = shapely.get_coordinates(shapely.centroid(shapely.Polygon(drawn)))[0]
        for surface in SURFACES:
            ours = [row for row in rows if (row["shape"], row["surface"]) == (shape, surface)]
            yield _recorded(ours, shape, surface, drawn, centroid)


def _recorded(
    rows: list[dict[str, str]], shape: str, surface: str, drawn: Array, centroid: Array
) -> Recorded:
    def column(*names: str) -> Array:
        return np.array([[float(row[name]) for name in names] for row in rows])

    start, angle = 1e3 * column("x0", "y0"), column("th0")[:, 0]

    def in_part(x: str, y: str) -> Array:
        return turned(1e3 * column(x, y) - start, -angle)

    def displacement(x: str, y: str, theta: str) -> Array:
        turn = wrap(column(theta)[:, 0] - angle)
        return about(np.column_stack([in_part(x, y), turn]), centroid)

    first, last = in_part("tip_x0", "tip_y0") - centroid, in_part("tip_x1", "tip_y1") - centroid
    pushes = Paths(first[:, None], first, np.zeros(len(rows)), last - first)
    outline = canonical(drawn).outline_mm
    beside = tips.beside(pushes, RADIUS_MM, outline, Path("pushes.csv"))
    authors = {
        f"authors' {name}": displacement(f"{key}_x1", f"{key}_y1", f"{key}_th1")
        for name, key in (("ellipsoid", "ell"), ("quartic", "quartic"))
    }
    measured = displacement("x1", "y1", "th1")
    return Recorded(
        shape, surface, outline, -centroid, beside.paths, overlap(first, outline), measured, authors
    )


def overlap(tip: Array, outline: Array) -> Array:
    """Depths (n,) to which round tips at `tip` (n, 2) overlap a part [mm]; negative: the gap between them."""
    part, centres = shapely.Polygon(outline), shapely.points(tip)
    away = shapely.distance(part.exterior, centres)
    return np.asarray(RADIUS_MM - np.where(shapely.contains(part, centres), -away, away))


def start_mm(sets: list[Recorded]) -> float:
    """The distance between tip and part that 68.3 % of the recorded pushes do not exceed at the start [mm].

    An overlap counts as a distance, too. In an exact record all tips would start in contact.
    """
    off_mm = np.abs(np.concatenate([each.overlap_mm for each in sets]))
    return round(float(np.quantile(off_mm, 0.683)), 3)


def turned(points: Array, angle: Array) -> Array:
    """Rotates each of n points (n, 2) about the origin by its angle (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = points.T
    return np.column_stack([c * x - s * y, s * x + c * y])


def about(moved: Array, place: Array) -> Array:
    """Converts displacements (n, 3) of a part's origin to those of the part's point `place` (2,)."""
    there = np.repeat(place[None], len(moved), axis=0)
    return np.column_stack([moved[:, :2] + turned(there, moved[:, 2]) - place, moved[:, 2]])


def errors(moved: Array, pushes: Recorded) -> Errors:
    """Errors of predicted displacements (n, 3) of the centroid, compared with the measured ones."""
    off = about(moved, pushes.origin) - about(pushes.moved, pushes.origin)
    return Errors(np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(wrap(off[:, 2]))))


def new_job(pushes: Recorded) -> Job:
    """The job that `plan-init` writes for steel fingers, with the pushed outline and jaws that open 1 m."""
    answers = Answers(pushes.shape, 5.0, None, "robotiq-2f-85", "steel")
    square = Imported(SQUARE, 4, np.ptp(SQUARE, axis=0), ())
    written = job_file.parse(draft(square, "outlines.csv", answers), pushes.shape)
    part = {"outline_mm": np.round(pushes.outline, 4).tolist(), "symmetry": 1}
    return stated.exact(written.replaced(part=part, gripper={"opening_mm": 1000.0}))


def predicted(pushes: Recorded, part: Simulator, mu: float) -> Array:
    """Displacements (n, 3) of the centroid that a simulator predicts at friction `mu`, without scatter."""
    return part.push(pushes.paths, part.nominal(len(pushes.moved), mu), RADIUS_MM).moved


def worst(pushes: Recorded, moved: Array) -> dict[str, Any]:
    """The push whose end is predicted worst: its errors, and the outline and poses to draw it.

    Args:
        pushes: the recorded pushes.
        moved: predicted displacements (n, 3) of the centroid.
    """
    off = errors(moved, pushes)
    k = int(off.mm.argmax())
    authors = errors(pushes.authors["authors' quartic"], pushes)
    tip = pushes.paths.centres[k]
    drawn = {
        "outline_mm": simplified(pushes.outline, DRAWN_MM),
        "tip_mm": np.array([tip, tip + pushes.paths.shifts[k]]),
        "measured": stated.in_degrees(pushes.moved)[k],
        "predicted": stated.in_degrees(moved)[k],
    }
    return {
        "shape": pushes.shape,
        "surface": pushes.surface,
        "mm": round(float(off.mm[k]), 1),
        "deg": round(float(off.deg[k]), 1),
        "authors_mm": round(float(authors.mm[k]), 1),
        **{name: np.round(values, 2).tolist() for name, values in drawn.items()},
    }


def by_load(job: Job, end: Callable[[Simulator], Array]) -> dict[str, Array]:
    """Calls `end` with a simulator of the job for each pressure in `LOADS`; returns the results by name."""
    jobs = {name: job.replaced(pressure=load) for name, load in LOADS.items()}
    return {name: end(Simulator.of_job(loaded, 1)) for name, loaded in jobs.items()}


def squeezed(path: Path) -> dict[str, Array]:
    """Displacements (n, 3) of a job's part in squeezes from random poses, for each pressure in `LOADS`."""
    job = job_file.load(path)
    start = random_poses(np.random.default_rng(0), SQUEEZES, job.uncertainty.radius_mm)
    mu = 0.5 * (job.friction.finger_part_min + job.friction.finger_part_max)
    return by_load(job, lambda part: part.roll_out(start, part.nominal(SQUEEZES, mu)).poses - start)


def elsewhere(all_moved: list[dict[str, Array]]) -> dict[str, float]:
    """Compares where squeezed parts end under the pressures `area` and `quartic`, and under `rim`.

    Only parts that move under `rim` count. Returns their number, their median displacement under `rim`, and
    for each of the other two pressures the share of them that ends elsewhere than under `rim`.
    """
    moved = {load: np.concatenate([each[load] for each in all_moved]) for load in LOADS}
    touched = moved["rim"].any(axis=1)
    rim = moved["rim"][touched]
    row = {"count": len(rim), "moved_mm": round(float(np.median(np.hypot(*rim[:, :2].T))), 2)}
    for load in ("area", "quartic"):
        off = moved[load][touched] - rim
        turn = np.degrees(np.abs(wrap(off[:, 2])))
        far = (np.hypot(off[:, 0], off[:, 1]) > APART_MM) | (turn > APART_DEG)
        row[load] = round(float(far.mean()), 4)
    return row


def pairs_of(folder: Path, pushes: Recorded, rho: float) -> identify.Normalised:
    """The recorded pairs of wrench and twist, about the centroid, normalised by `rho` [mm]."""
    rows = [
        [float(row[name]) for name in ("fx", "fy", "tau_rho", "vx", "vy", "om_rho")]
        for row in read(folder / "wrench_twist.csv")
        if (row["shape"], row["surface"]) == (pushes.shape, pushes.surface)
    ]
    F, V = np.split(np.array(rows), 2, axis=1)
    drawn = pushes.outline - pushes.origin  # about the origin of the poses
    ours = np.hypot(*(drawn - drawn.mean(axis=0)).T).mean()
    x, y = -pushes.origin  # of the centroid
    torque = F[:, 2] * ours - (x * F[:, 1] - y * F[:, 0])
    turn = V[:, 2] / ours
    wrenches = np.column_stack([F[:, :2], torque / rho])
    twists = np.column_stack([V[:, 0] - turn * y, V[:, 1] + turn * x, turn * rho])
    return identify.directions(Pairs(wrenches, twists, np.ones(len(F))))


def identified(folder: Path, pushes: Recorded, part: Simulator) -> Simulator:
    """The simulator `part` with a quartic identified from the recorded pairs of wrench and twist."""
    rho = radius_of_gyration(pushes.outline)
    data = pairs_of(folder, pushes, rho)
    surface = identify.fit(data, rho, "quartic", np.random.default_rng(0)).surface
    return replace(part, surface=surface)


def turning(folder: Path, pushes: Recorded) -> dict[str, float]:
    """How easily a part turns, relative to how easily it slides, by four limit surfaces.

    Three limit surfaces follow from assumed pressures. The fourth is fitted to the recorded pairs of wrench
    and twist.
    """
    rho = radius_of_gyration(pushes.outline)
    area, weights = support(Pressure("uniform", DRAWS), pushes.outline)
    loads = {
        "rim": support(Pressure("boundary", DRAWS), pushes.outline),
        "area": (area, weights),
        "middle": (MIDDLE * area, weights),
    }
    data = pairs_of(folder, pushes, rho)
    rng = np.random.default_rng(0)
    surfaces = {name: limit_surface.fit_ellipsoid(*load, rho) for name, load in loads.items()}
    surfaces["pairs"] = identify.fit(data, rho, "ellipsoid", rng).surface  # type: ignore[assignment]
    A = {name: surface.A for name, surface in surfaces.items()}
    return {name: round(float(2 * a[2, 2] / (a[0, 0] + a[1, 1])), 3) for name, a in A.items()}


def leave_one_out(result: dict[tuple[str, str], dict[float, Errors]], shape: str) -> float:
    """The friction at which the largest share of pushes of all other shapes ends near the measured pose."""
    shares = {
        mu: np.mean([ours[mu].near.mean() for (other, _), ours in result.items() if other != shape])
        for mu in FRICTIONS
    }
    return max(FRICTIONS, key=lambda mu: shares[mu])


def coverage(pushes: Recorded, job: Job, part: Simulator, seed: int) -> BoolArray:
    """Mask (S, n, 3): whether measured x, y and angle lie in central intervals of simulated pushes.

    Every `EVERY`-th recorded push is simulated `DRAWS` times, with the scatter that the job states. Its S
    central intervals hold the shares `SHARES` of the results.
    """
    rows = np.arange(0, len(pushes.moved), EVERY)
    many = Paths(*(np.repeat(values[rows], DRAWS, axis=0) for values in pushes.paths))
    pushed = stated.draw(part, job, many, RADIUS_MM, np.random.default_rng(seed))
    drawn, half = pushed.moved.reshape(len(rows), DRAWS, 3), 0.5 * np.array(SHARES)
    low, high = (np.quantile(drawn, quantiles, axis=1) for quantiles in (0.5 - half, 0.5 + half))
    return np.asarray((low <= pushes.moved[rows]) & (pushes.moved[rows] <= high))


def figures(ours: list[Errors]) -> dict[str, float]:
    """The number of pushes, the share that ends near the measured pose, and quantiles of the errors."""
    mm, deg = (np.concatenate(column) for column in zip(*ours, strict=True))
    return {
        "pushes": len(mm),
        "near": round(float(Errors(mm, deg).near.mean()), 4),
        "median_mm": round(float(np.median(mm)), 3),
        "p90_mm": round(float(np.quantile(mm, 0.9)), 3),
        "median_deg": round(float(np.median(deg)), 3),
        "p90_deg": round(float(np.quantile(deg, 0.9)), 3),
    }


def measured(folder: Path) -> dict[str, Any]:
    """Predicts all pushes with all models; returns the content of the file of results."""
    friction = (FINGERS["steel"].low, FINGERS["steel"].high)
    middle = 0.5 * sum(friction)
    sets = {(each.shape, each.surface): each for each in recorded(folder, "held20")}
    ours: dict[str, dict[tuple[str, str], Errors]] = {model: {} for model in MODELS}
    pairs: dict[tuple[str, str], dict[float, Errors]] = {}
    covered: dict[tuple[str, str], BoolArray] = {}
    farthest: dict[str, dict[str, Any]] = {}
    pushed: list[dict[str, Array]] = []
    for number, (key, pushes) in enumerate(sets.items()):
        job = new_job(pushes)
        new = Simulator.of_job(job, 1)
        plain = job.replaced(pressure=UNIFORM, doubt={"pressure": "stated"})
        uniform = Simulator.of_job(plain, 1)
        nominal = predicted(pushes, new, middle)
        ours["uniform, friction .25"][key] = errors(predicted(pushes, uniform, 0.25), pushes)
        ours["new job"][key] = errors(nominal, pushes)
        rows = [worst(pushes, nominal), farthest.get(pushes.shape, {"mm": 0.0})]
        farthest[pushes.shape] = max(rows, key=lambda row: row["mm"])
        pushed.append(by_load(job, lambda part, p=pushes: predicted(p, part, middle)))  # type: ignore[misc]
        for model, moved in pushes.authors.items():
            ours[model][key] = errors(moved, pushes)
        part = identified(folder, pushes, uniform)
        pairs[key] = {mu: errors(predicted(pushes, part, mu), pushes) for mu in FRICTIONS}
        covered[key] = coverage(pushes, job, new, number)
    chosen = {shape: leave_one_out(pairs, shape) for shape, _ in sets}
    ours["from own pairs"] = {key: values[chosen[key[0]]] for key, values in pairs.items()}

    def grouped(pick: Callable[[tuple[str, str]], bool]) -> dict[str, Any]:
        keys = [key for key in sets if pick(key)]
        shares = np.concatenate([covered[key] for key in keys], axis=1).mean(axis=1).round(4)
        curves = dict(zip(("x", "y", "turn"), shares.T.tolist(), strict=True))
        return {
            **{model: figures([ours[model][key] for key in keys]) for model in MODELS},
            "coverage": {name: curve[SHARES.index(0.9)] for name, curve in curves.items()},
            "calibration": curves,
        }

    shapes = list(dict.fromkeys(shape for shape, _ in sets))
    groups = {"all": grouped(lambda _: True)}
    groups |= {surface: grouped(lambda key, s=surface: key[1] == s) for surface in SURFACES}  # type: ignore[misc]
    for shape in shapes:
        groups[shape] = grouped(lambda key, s=shape: key[0] == s)  # type: ignore[misc]
    depth = np.concatenate([pushes.overlap_mm for pushes in sets.values()])
    return {
        "friction": {"new job": middle, "from own pairs": chosen},
        "pressure": f"{job.pressure.kind}, {job.pressure.limit_surface}",
        "overlapping": round(float((depth > 0.05).mean()), 4),
        "start_mm": {
            **{s: start_mm([sets[key] for key in sets if key[1] == s]) for s in SURFACES},
            **{
                f"without {s}": start_mm([sets[key] for key in sets if key[0] != s]) for s in shapes
            },
        },
        "turning": [
            {"shape": shape, "surface": surface, **turning(folder, pushes)}
            for (shape, surface), pushes in sets.items()
        ],
        "nominal": SHARES,
        "radius_mm": RADIUS_MM,
        "groups": groups,
        "worst": list(farthest.values()),
        "elsewhere": {
            "pushes": elsewhere(pushed),
            "squeezes": elsewhere([squeezed(path) for path in JOBS]),
        },
    }


def main() -> int:
    """Measures all figures, prints them and writes them to the file of results; returns the exit code."""
    parser = harness.parser(__doc__)
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER")
    options = parser.parse_args()
    if missing := [name for name in FILES if not (options.data / name).is_file()]:
        said = f"{options.data} has no {', '.join(missing)}; see --help"
        print(f"bench_contact: {said}", file=sys.stderr)
        return 3
    result = measured(options.data)
    for name, group in result["groups"].items():
        harness.show({name: group})
    RESULTS.write(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
