"""plan-simulate: single squeezes, rolled out from a list of poses."""

import argparse
import csv
import io
import math
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from planner.arrays import Array
from planner.cli import shell
from planner.errors import InputFileError, KeyNameError, UsageError, ValueRangeError
from planner.job import documents
from planner.job import model as job_file
from planner.mechanics.simulator import DEFAULT_STEP_MM, STATUS_NAMES, Parameters, RollOut, Simulator
from runtime.shell.command import Parser, natural, positive_int
from runtime.shell.files import usable, words_of, writing

NAME = "plan-simulate"
INPUTS = ("x_mm", "y_mm", "theta_rad")
PICTURES = {"figure": shell.PICTURES, "gif": (".gif",), "html": (".html",)}  # what they may end in
OUTPUTS = ("final_x_mm", "final_y_mm", "final_theta_rad", "width_mm", "status")


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return shell.run(parser(), argv, _simulate)


def _simulate(arguments: argparse.Namespace) -> int:
    _check_options(arguments.nominal, arguments.mu, arguments.step_mm)
    pictures = {name: path for name in PICTURES if (path := getattr(arguments, name)) is not None}
    for name, path in pictures.items():
        shell.checked_suffix(f"--{name}", path, PICTURES[name])
    job = job_file.load(arguments.job)
    read = (*job_file.files(arguments.job), arguments.poses)
    outputs = [usable(arguments.output, *read, stdout=True)]
    for path in pictures.values():
        outputs.append(usable(path, *read, *outputs))
    poses = read_poses(arguments.poses)
    if pictures and not len(poses):
        raise ValueRangeError("has no poses to draw; add a line", where=str(arguments.poses))
    simulator = Simulator.of_job(job, arguments.workers, arguments.step_mm)
    if arguments.nominal:
        parameters = simulator.nominal(len(poses), arguments.mu)
    else:
        seed = job.seed if arguments.seed is None else arguments.seed
        parameters = simulator.sample(len(poses), np.random.default_rng(seed))
    rolled = simulator.roll_out(poses, parameters)
    with writing(arguments.output) as draft:
        write_results(draft, poses, rolled)
    if pictures:
        draw(pictures, simulator, poses, parameters, f"{job.part.name}: {arguments.poses.name}")
    with redirect_stdout(words_of(arguments.output)):
        _report(rolled, arguments.output, pictures, arguments.json)
    return 0


def parser() -> Parser:
    """The command's arguments."""
    built = shell.parser(
        NAME,
        "Squeeze a part once from each of many poses. Poses are the part's in the hand frame: hand at the "
        "origin, jaws fully open, closing along y. Where the open fingers would stand on the part, it is "
        "reported as jammed at full opening, unmoved.",
        f"{NAME} trees/rectangle/job.toml --poses in.csv -o out.csv --nominal --mu 0.5",
        f"{NAME} job.toml --poses in.csv -o out.csv --figure squeezes.svg --html squeezes.html",
    )
    add = built.add_argument
    add("job", type=Path, metavar="JOB.toml", help="the job file")
    add("--poses", type=Path, required=True, metavar="IN.csv", help=f"with a header: {','.join(INPUTS)}")
    add(
        "-o", "--output", type=Path, required=True, metavar="OUT.csv",
        help="the results; - for standard output",
    )  # fmt: skip
    add("--nominal", action="store_true", help="the nominal limit surface, no scatter; needs --mu")
    add("--mu", type=float, help="friction between finger and part, with --nominal")
    add("--seed", type=natural, help="of the scatter (default: the job's)")
    add(
        "--step-mm", type=float, default=DEFAULT_STEP_MM,
        help="closing step of a finger (default: %(default)s)",
    )  # fmt: skip
    add("--workers", type=positive_int, help="threads (default: cores)")
    add("--figure", type=Path, metavar="OUT.png", help="draw the first squeezes, up to 12 (.png, .svg, .pdf)")
    add("--gif", type=Path, metavar="OUT.gif", help="animate the first squeeze")
    add("--html", type=Path, metavar="OUT.html", help="a page with a slider: the first squeezes, up to 12")
    return built


def draw(
    pictures: dict[str, Path], simulator: Simulator, poses: Array, parameters: Parameters, title: str
) -> None:
    """Squeezes the first poses (n, 3), n >= 1, once more, step by step, and draws what was asked for.

    The files go by the names of `PICTURES`; the simulator and the parameters are those of the results.
    """
    from planner.report import canvas, trajectory  # matplotlib takes its time

    traces = []
    cases = zip(poses, parameters.surfaces, parameters.mu, strict=True)
    for pose, surface, mu in list(cases)[: trajectory.MOST_PANELS]:
        states, status = simulator.trace(pose, surface, float(mu[0]))
        traces.append(trajectory.Squeezed(states, STATUS_NAMES[status]))
    outline, jaws = simulator.outline, simulator.jaws
    if path := pictures.get("figure"):
        canvas.save(path, lambda: trajectory.figure(outline, jaws, traces))
    if path := pictures.get("gif"):
        trajectory.gif(outline, jaws, traces[0], path)
    if path := pictures.get("html"):
        trajectory.html(outline, jaws, traces, title, path)


def _check_options(nominal: bool, mu: float | None, step_mm: float) -> None:
    if nominal != (mu is not None):
        raise UsageError("--nominal and --mu go together: state the one friction value, such as --mu 0.5")
    if mu is not None and not 0.0 <= mu <= 2.0:
        raise UsageError(f"--mu {mu} is not between 0 and 2")
    if not 1e-4 <= step_mm <= 2.0:
        raise UsageError(f"--step-mm {step_mm} is not between 0.0001 and 2")


def read_poses(path: Path) -> Array:
    """Reads (n, 3) poses from a CSV file with the columns `INPUTS`; others are ignored.

    Raises:
        InputFileError: the file is missing or not text.
        KeyNameError: a column is missing.
        ValueRangeError: a value is not a finite number; names the line.
    """
    where = str(path)
    try:
        reader = csv.DictReader(io.StringIO(documents.read(path), newline=""))
        header = [name.strip() for name in reader.fieldnames or []]
        reader.fieldnames = header
        if missing := [name for name in INPUTS if name not in header]:
            problem = f"column {', '.join(missing)} is missing; the header must name {','.join(INPUTS)}"
            raise KeyNameError(problem, where=where)
        rows = [[_number(row[name], name, where, reader.line_num) for name in INPUTS] for row in reader]
    except csv.Error as error:
        raise InputFileError(f"not a CSV file: {error}", where=where) from error
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _number(text: str | None, name: str, where: str, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueRangeError(f"line {line}: {text!r} is not a finite number", where=where, key=name)
    return value


def write_results(path: Path, poses: Array, rolled: RollOut) -> None:
    """Writes inputs and results, one line a pose."""
    numbers = np.column_stack([poses, rolled.poses, rolled.width_mm])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*INPUTS, *OUTPUTS])
        for row, status in zip(numbers, rolled.status, strict=True):
            writer.writerow([*(f"{value:.9g}" for value in row), STATUS_NAMES[status]])


def _report(rolled: RollOut, output: Path, pictures: dict[str, Path], as_json: bool) -> None:
    tally = {name: int(np.sum(rolled.status == k)) for k, name in enumerate(STATUS_NAMES)}
    given_up = int(rolled.given_up.sum())
    if as_json:
        told = {"output": str(output), "squeezes": len(rolled.poses), **tally, "given_up": given_up}
        shell.print_json(told | {name: str(path) for name, path in pictures.items()})
        return
    parts = ", ".join(f"{count} {name}" for name, count in tally.items() if count)
    files = ", ".join(map(str, (output, *pictures.values())))
    print(f"{len(rolled.poses)} squeezes: {parts or 'none'}; wrote {files}")
    if given_up:
        words = f"{given_up} squeezes could not be stepped to their end; try --step-mm"
        print(f"{NAME}: {words}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
