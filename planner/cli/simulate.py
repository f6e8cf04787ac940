"""plan-simulate: single squeezes from a list of poses, or single pushes along a list of paths."""

import argparse
import math
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner import columns
from planner.arguments import FARTHEST
from planner.arrays import Array
from planner.cli import pushes, shell, tips
from planner.errors import KeyNameError
from planner.job import model as job_file
from planner.job.model import Job
from planner.mechanics.push import PUSH_NAMES
from planner.mechanics.simulator import DEFAULT_STEP_MM, STATUS_NAMES, Parameters, Simulator
from runtime.shell.command import Parser, natural, positive, positive_int
from runtime.shell.errors import InputError
from runtime.shell.files import usable, words_of

NAME = "plan-simulate"
RADIANS, DEGREES = "theta_rad", "theta_deg"
INPUTS = ("x_mm", "y_mm", RADIANS)
# Options that draw, and the suffixes of their files.
PICTURES = {"figure": shell.PICTURES, "html": (".html",)}
IN_DEGREES = ("x_mm", "y_mm", DEGREES)  # columns of poses with angles in degrees
# Final pose and width, then the angles again, in degrees.
RESULTS = (*(f"final_{name}" for name in INPUTS), "width_mm", "theta_deg", "final_theta_deg")
MOST_RADIUS_MM, MOST_DRAWS = 1000.0, 100_000
RANGES = {"mu": (0, 2), "step_mm": (1e-4, 2), "fingers_mm": (0, 1000), "start_mm": (0, 10)}
SAME_DEG = 1e-5  # rounding error between an angle in degrees and the same in radians


class Results(NamedTuple):
    """Results of n squeezes or pushes, ready to be written."""

    what: tuple[str, str]  # nouns for one of them, and for several
    table: columns.Table
    status: list[str]  # (n,) each one of `names`
    names: tuple[str, ...]
    given_up: int  # number of squeezes or pushes that were cut short
    drawn: tuple[Array, Parameters] | None = None  # poses (n, 3) and mechanics for pictures


def _simulate(arguments: argparse.Namespace) -> None:
    pictures = {name: path for name in PICTURES if (path := getattr(arguments, name)) is not None}
    shell.refuse(_mistakes(arguments, pictures))
    for name, path in pictures.items():
        shell.check_suffix(f"--{name}", path, PICTURES[name])
    job = job_file.load(arguments.job, tips.ANY_OPENING if arguments.push else None)
    shell.check_one_part(job.hypothesis, str(arguments.job), "a simulation")
    listed: Path = arguments.poses or arguments.push
    read = (*job_file.files(arguments.job), listed)
    outputs = [usable(arguments.output, *read, stdout=True)]
    for path in pictures.values():
        outputs.append(usable(path, *read, *outputs))
    job = pushes.exact(job) if arguments.push else job
    simulator = Simulator.of_job(job, arguments.workers, arguments.step_mm)
    results = (_squeezed if arguments.poses else _pushed)(simulator, arguments, job)
    status, given_up, (one, what) = results.status, results.given_up, results.what
    columns.write(arguments.output, results.table)
    if results.drawn is not None and pictures:
        draw(pictures, simulator, *results.drawn, f"{job.part.name}: {listed.name}")
    tally = {name: status.count(name) for name in results.names}
    drawn = {name: str(path) for name, path in pictures.items()}
    after = {"given_up": given_up, **drawn}
    counts = ", ".join(f"{count} {name}" for name, count in tally.items() if count)
    written = ", ".join((str(arguments.output), *drawn.values()))
    figures = {"output": str(arguments.output), what: len(status), **tally, **after}
    line = f"{len(status)} {one if len(status) == 1 else what}: {counts or 'none'}; wrote {written}"
    with redirect_stdout(words_of(arguments.output)):
        shell.answer(arguments.json, figures, line)
    if given_up and not arguments.json:
        words = f"{given_up} of {len(status)} {what} could not be stepped to the end; try --step-mm"
        print(f"{NAME}: {words}", file=sys.stderr)


def _rng(arguments: argparse.Namespace, job: Job, *stream: int) -> np.random.Generator:
    """Returns a random generator, seeded by --seed or else by the job; each `stream` gives other numbers."""
    seed = job.seed if arguments.seed is None else arguments.seed
    return np.random.default_rng([seed, *stream] if stream else seed)


def _squeezed(simulator: Simulator, arguments: argparse.Namespace, job: Job) -> Results:
    poses = read_poses(arguments.poses)
    if not len(poses) and any(getattr(arguments, name) is not None for name in PICTURES):
        raise InputError("has no poses to draw; add a line", where=str(arguments.poses))
    if arguments.nominal:
        parameters = simulator.nominal(len(poses), arguments.mu)
    else:
        parameters = simulator.sample(len(poses), _rng(arguments, job))
    rolled = simulator.roll_out(poses, parameters)
    degrees = np.degrees(np.column_stack([poses[:, 2], rolled.poses[:, 2]]))
    numbers = np.column_stack([poses, rolled.poses, rolled.width_mm, degrees])
    status = [STATUS_NAMES[k] for k in rolled.status]
    table: columns.Table = {**columns.named((*INPUTS, *RESULTS), numbers), "status": status}
    given_up, drawn = int(rolled.given_up.sum()), (poses, parameters)
    return Results(("squeeze", "squeezes"), table, status, STATUS_NAMES, given_up, drawn)


def _pushed(simulator: Simulator, arguments: argparse.Namespace, job: Job) -> Results:
    path, outline, radius = arguments.push, job.part.outline_mm, arguments.tip_radius_mm
    tip_mm = radius or 0.0
    centroid = job_file.centroid_as_drawn(arguments.job)
    if radius is None or arguments.fingers_mm is not None:
        stated = pushes.read(path, arguments.fingers_mm)
        ways = pushes.paths(stated, centroid)
    else:
        stated = tips.read(path)
        ways = tips.paths(stated, centroid)
    further: columns.Table = {}
    if radius is None:
        pushes.check_clear(ways, outline, path)
    else:
        ways, further[tips.OVERLAP] = tips.beside(ways, radius, outline, path)
    if arguments.nominal:
        nominal = simulator.nominal(len(ways.angles), arguments.mu)
        pushed = simulator.push(ways, nominal, tip_mm)
    else:
        pushed = pushes.draw(simulator, job, ways, tip_mm, _rng(arguments, job))
    given_up = int(pushed.given_up.sum())
    if arguments.draws is not None:
        # A separate stream: the lines are the same with and without --draws.
        rng = _rng(arguments, job, arguments.draws)
        start_mm = pushes.START_MM if arguments.start_mm is None else arguments.start_mm
        draws = pushes.Draws(arguments.draws, start_mm)
        drawn = pushes.drawn(simulator, job, ways, tip_mm, draws, rng)
        further |= columns.named(pushes.BOUNDS, drawn.bounds)
        given_up += drawn.given_up
    names = PUSH_NAMES if radius is None else tips.STATUS_NAMES
    status = [names[k] for k in (pushed.status if radius is None else tips.status(pushed))]
    moved = columns.named(tips.MOVED, pushes.in_degrees(pushed.moved))
    table: columns.Table = {**stated, **moved, "status": status, **further}
    return Results(("push", "pushes"), table, status, names, given_up)


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Squeeze a part once from each of many poses. Poses are the part's in the hand frame: hand at the "
        "origin, jaws fully open, closing along y. A part on which the open fingers would stand is reported "
        "as jammed at full opening, unmoved. Or push the part once along each of many paths: two fingers "
        "touch an edge and turn about a centre, given in the frame of the job's outline_mm; a part that ends "
        "within 10 mm and 5 degrees of where the fingers carry it is stuck, one that they left is lost.",
        f"{NAME} trees/rectangle/job.toml --poses in.csv -o out.csv --nominal --mu 0.5",
        f"{NAME} job.toml --poses in.csv -o out.csv --figure squeezes.svg --html squeezes.html",
        f"{NAME} job.toml --push in.csv -o out.csv --nominal --mu 0.5 --fingers-mm 50",
        f"{NAME} job.toml --push in.csv -o out.csv --tip-radius-mm 4.75 --draws 200",
    )
    add = built.add_argument
    add("job", type=Path, metavar="JOB.toml", help="the job file")
    listed = built.add_mutually_exclusive_group(required=True)
    text = f"poses to squeeze at; header: {','.join(INPUTS)}, or {DEGREES} in place of {RADIANS}"
    listed.add_argument("--poses", type=Path, metavar="IN.csv", help=text)
    text = (
        f"pushes; header: {','.join((*pushes.PLACES, pushes.FINGERS))}, and if the centre of rotation moves, "
        f"{','.join(pushes.SHIFTS)}"
    )
    listed.add_argument("--push", type=Path, metavar="IN.csv", help=text)
    without = f"for pushes without a column {pushes.FINGERS}"
    text = f"distance of the two fingers, {without}; 0: one finger"
    add("--fingers-mm", type=float, metavar="MM", help=text)
    shell.add_output(built, "OUT.csv", "the results; - for standard output")
    text = (
        f"push with a round tip of this radius; header: {','.join(tips.NAMES)}, the tip's centre at "
        "the start and its whole way; a tip that overlaps the part starts at the nearest place beside it. "
        "With --fingers-mm: two such tips, on the columns of two fingers"
    )
    add("--tip-radius-mm", type=positive, metavar="MM", help=text)
    draws = "N draws of the mechanics and of what the job doubts"
    text = f"add the 5th and 95th percentile of each push's displacement over {draws}"
    add("--draws", type=positive_int, metavar="N", help=text)
    usual = f"default: {pushes.START_MM}, as in recorded pushes"
    text = f"standard deviation of x and of y at which a pusher starts, for --draws ({usual})"
    add("--start-mm", type=float, metavar="MM", help=text)
    add("--nominal", action="store_true", help="nominal limit surface without scatter; needs --mu")
    add("--mu", type=float, help="friction between finger and part, with --nominal")
    add("--seed", type=natural, help="seed of the scatter (default: the job's)")
    text = "step of a finger that closes or pushes (default: %(default)s)"
    add("--step-mm", type=float, default=DEFAULT_STEP_MM, help=text)
    add("--workers", type=positive_int, help="threads (default: cores)")
    text = "draw the first squeezes, up to 12 (.png, .svg, .pdf)"
    add("--figure", type=Path, metavar="OUT.png", help=text)
    text = "a page with a slider: the first squeezes, up to 12"
    add("--html", type=Path, metavar="OUT.html", help=text)
    return built


def read_poses(path: Path) -> Array:
    """Reads poses (n, 3) [mm, mm, rad] from a file that states angles in radians or in degrees.

    Raises:
        InputError: see `columns.read`; or the two angles of a line differ, or a pose is too far away.
    """
    poses = _stated_poses(path)
    if len(poses) and np.abs(poses).max() > FARTHEST:
        number = int(np.argmax(np.abs(poses).max(axis=1))) + 1
        raise InputError(f"pose {number}: is beyond {FARTHEST:g} mm or rad", where=str(path))
    return poses


def _stated_poses(path: Path) -> Array:
    try:
        x, y, theta = columns.read(path, INPUTS).values()
    except KeyNameError:
        with suppress(KeyNameError):
            x, y, theta = columns.read(path, IN_DEGREES).values()
            return np.column_stack([x, y, np.radians(theta)])
        raise
    stated = columns.read(path, (), {DEGREES: math.nan})[DEGREES]
    apart = np.abs(np.degrees(theta) - stated)
    if (apart > SAME_DEG).any():
        number = int(np.argmax(apart > SAME_DEG)) + 1
        problem = f"pose {number}: the two differ; leave one column out"
        raise InputError(problem, where=str(path), key=f"{RADIANS}, {DEGREES}")
    return np.column_stack([x, y, theta])


def draw(
    pictures: dict[str, Path],
    simulator: Simulator,
    poses: Array,
    parameters: Parameters,
    title: str,
) -> None:
    """Simulates the first squeezes of a list again, to record their steps, and draws them.

    The squeezes start at `poses` (n, 3), n >= 1; at most `trajectory.MOST_PANELS` of them are drawn.
    `pictures` maps names of `PICTURES` to the files to write. Simulator and parameters are those with which
    the squeezes were simulated before.
    """
    from planner.report import canvas, trajectory  # importing matplotlib is slow

    traces = []
    cases = zip(poses, parameters.surfaces, parameters.mu, strict=True)
    for pose, surface, mu in list(cases)[: trajectory.MOST_PANELS]:
        states, status = simulator.trace(pose, surface, float(mu[0]))
        traces.append(trajectory.Squeezed(states, STATUS_NAMES[status]))
    outline, jaws = simulator.outline, simulator.jaws
    if path := pictures.get("figure"):
        canvas.save(path, lambda: trajectory.figure(outline, jaws, traces))
    if path := pictures.get("html"):
        trajectory.html(outline, jaws, traces, title, path)


def _mistakes(arguments: argparse.Namespace, pictures: dict[str, Path]) -> Iterator[str]:
    if arguments.nominal != (arguments.mu is not None):
        yield "--nominal and --mu go together: state the one friction value, such as --mu 0.5"
    for option, (least, most) in RANGES.items():
        value = getattr(arguments, option)
        if value is not None and not least <= value <= most:
            name = f"--{option.replace('_', '-')}"
            yield f"{name} {value} is not between {least:g} and {most:g}"
    if arguments.push and pictures:
        yield f"--{next(iter(pictures))} draws squeezes; leave it out with --push"
    if arguments.nominal and arguments.draws is not None:
        yield "--draws draws the mechanics and --nominal does not; leave one of them out"
    if arguments.start_mm is not None and arguments.draws is None:
        yield "--start-mm goes with --draws"
    for option in ("tip_radius_mm", "draws"):
        if arguments.poses and getattr(arguments, option) is not None:
            yield f"--{option.replace('_', '-')} goes with --push"
    if arguments.tip_radius_mm is not None and arguments.tip_radius_mm > MOST_RADIUS_MM:
        yield f"--tip-radius-mm {arguments.tip_radius_mm:g} is beyond {MOST_RADIUS_MM:g}"
    if arguments.draws is not None and arguments.draws > MOST_DRAWS:
        yield f"--draws {arguments.draws} is beyond {MOST_DRAWS}"
    if arguments.poses and arguments.fingers_mm is not None:
        yield "--fingers-mm goes with --push; the job's [gripper] has the jaws that squeeze"


main = shell.main_of(parser, _simulate)
