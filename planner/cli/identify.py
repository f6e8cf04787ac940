"""plan-identify: fits a limit surface to measured pushes and states its error on unseen pushes."""

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from planner import columns
from planner.cli import shell, tips
from planner.identification import identify, motions, pushes
from planner.identification.identify import LEAST_PAIRS, Identified, Kind, Normalised
from planner.job import model as job_file
from planner.job import surface_file
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.simulator import Simulator
from runtime.shell.command import Parser, number, positive, positive_int
from runtime.shell.errors import InputError
from runtime.shell.files import usable, write

NAME = "plan-identify"
MOST_SPLITS = 10  # most random splits that judge a fit to --motions
KINDS: tuple[Kind, ...] = ("ellipsoid", "quartic")
FORMATS = files("planner").joinpath("templates/push_formats.txt").read_text("utf-8")


def _identify(arguments: argparse.Namespace) -> None:
    shell.refuse(_mistakes(arguments))
    if arguments.motions is not None:
        _from_motions(arguments)
        return
    sources = [*arguments.logs, *arguments.pairs]
    if arguments.figure is not None:
        shell.check_suffix("--figure", arguments.figure, shell.PICTURES)
        usable(arguments.figure, arguments.output, *sources)
    if arguments.output is not None:
        usable(arguments.output, *sources)
    rho_mm = arguments.rho_mm
    if arguments.pairs:
        tables = [pushes.load_table(path, pushes.DIRECTIONS) for path in arguments.pairs]
        data: Normalised = identify.directions(pushes.join(tables))
    else:
        logs = pushes.join([pushes.load(path) for path in arguments.logs])
        data = identify.normalise(logs, rho_mm)
    kinds = KINDS if arguments.kind == "both" else (arguments.kind,)
    with shell.progress(arguments.json) as report:
        outcome = identify.identify(
            data,
            rho_mm,
            kinds,
            splits=arguments.splits,
            train_share=arguments.train_share,
            seed=arguments.seed,
            friction_n=arguments.friction_n,
            report=report,
        )
    best = min(outcome, key=lambda result: float(result.errors_rad.mean()))
    if arguments.output is not None:
        write(arguments.output, surface_text(best, data, arguments))
    if arguments.figure is not None:
        from planner.report import canvas, identification  # importing matplotlib takes a second

        title = f"{', '.join(path.stem for path in sources)}: {len(data.F)} pushes"
        canvas.save(arguments.figure, lambda: identification.figure(data, outcome, title))
    _print(data, outcome, best, arguments)


def _mistakes(arguments: argparse.Namespace) -> Iterator[str]:
    needed = arguments.job, arguments.tip_radius_mm
    if arguments.motions is not None:
        if None in needed or arguments.logs or arguments.pairs:
            yield "--motions needs --job and --tip-radius-mm, and goes without logs and --pairs"
        if arguments.figure or arguments.friction_n or arguments.kind == "quartic":
            yield "--motions gives an ellipsoid; leave out --figure, --friction-n and --kind quartic"
        return
    if needed != (None, None):
        yield "--job and --tip-radius-mm go with --motions"
    if bool(arguments.logs) == bool(arguments.pairs):
        yield "state push logs, or tables of directions with --pairs"
    if arguments.pairs and arguments.friction_n is not None:
        yield "--friction-n goes with logs: --pairs takes no magnitudes"


def _from_motions(arguments: argparse.Namespace) -> None:
    path, radius_mm = arguments.motions, arguments.tip_radius_mm
    job = job_file.load(arguments.job, tips.ANY_OPENING)
    shell.check_one_part(job.hypothesis, str(arguments.job), "an identification")
    if arguments.output is not None:
        usable(arguments.output, path, *job_file.files(arguments.job))
    stated = columns.read(path, (*tips.NAMES, *tips.MOVED))
    ways = tips.paths(stated, job_file.centroid_as_drawn(arguments.job))
    if (pushes := len(ways.angles)) < LEAST_PAIRS:
        raise InputError(f"{pushes} pushes; give at least {LEAST_PAIRS}", where=str(path))
    beside = tips.beside(ways, radius_mm, job.part.outline_mm, path)
    x, y, turned = (stated[name] for name in tips.MOVED)
    measured = motions.Motions(beside.paths, np.column_stack([x, y, np.radians(turned)]))
    part = Simulator.of_job(job, 1)
    fitted = motions.fit(measured, part, radius_mm)
    errors_mm = motions.errors_mm(fitted, measured, part, radius_mm)
    rng = np.random.default_rng(arguments.seed)
    unseen = motions.held_out_mm(measured, part, radius_mm, min(arguments.splits, MOST_SPLITS), rng)
    figures = {
        "pushes": pushes,
        "friction": round(fitted.friction, 4),
        "median_error_mm": round(float(np.median(errors_mm)), 3),
        "held_out_error_mm": round(float(unseen.mean()), 3),
    }
    written = list[str]()
    if arguments.output is not None:
        values = {"rho_mm": fitted.surface.rho_mm, "ellipsoid": fitted.surface.A}
        write(arguments.output, surface_file.dumps(values, {"motions": str(path), **figures}))
        written.append(str(arguments.output))
    shell.answer(
        arguments.json,
        {**figures, "written": written},
        f"{pushes} pushes: friction of the tip {fitted.friction:.3f}; median error "
        f"{np.median(errors_mm):.2f} mm, {unseen.mean():.2f} mm on halves that were not fitted to",
        *(f"wrote {name}: the ellipsoid" for name in written),
    )


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Identify the limit surface of a part on its table from measured pushes, and judge it on pushes that "
        "it was not fitted to. A job takes the result in place of a pressure distribution.",
        f"{NAME} pushes.txt -o surface.toml --figure surface.png",
        f"{NAME} monday.txt tuesday.txt --kind quartic --json",
        f"{NAME} --motions pushes.csv --job job.toml --tip-radius-mm 4.75 -o surface.toml",
        f"{NAME} --pairs pairs.csv --rho-mm 45.6 --splits 10 -o surface.toml",
    )
    built.epilog = FORMATS + (built.epilog or "")
    add = built.add_argument
    add("logs", type=Path, nargs="*", metavar="LOG", help="push logs, or tables of pairs (.csv)")
    text = f"tables of directions in place of logs: {','.join(pushes.DIRECTIONS)}"
    add("--pairs", type=Path, nargs="+", default=[], metavar="PAIRS.csv", help=text)
    named = (
        f"{','.join((*tips.NAMES, *tips.MOVED))}, as plan-simulate --push --tip-radius-mm writes"
    )
    text = f"pushes by a round tip, measured without forces: {named}; gives the tip's friction, too"
    add("--motions", type=Path, metavar="PUSHES.csv", help=text)
    add("--job", type=Path, metavar="JOB.toml", help="job file of the part of --motions")
    add("--tip-radius-mm", type=positive, metavar="MM", help="radius of the tip of --motions")
    shell.add_output(built, "SURFACE.toml", "the limit surface", required=False)
    add("--figure", type=Path, metavar="OUT.png", help="draw it (.png, .svg, .pdf)")
    text = "kind of limit surface; both: the better predictor is written (default: %(default)s)"
    add("--kind", choices=(*KINDS, "both"), default="both", help=text)
    text = "length that torques are divided by (default: %(default)g)"
    add("--rho-mm", type=positive, default=75.0, help=text)
    text = "force of friction between part and table in N (default: estimated from the pushes)"
    add("--friction-n", type=positive, help=text)
    text = "number of random splits by which a fit is judged (default: %(default)s)"
    add("--splits", type=positive_int, default=50, help=text)
    text = "share of the pushes that a split fits to (default: %(default)g)"
    add("--train-share", type=_share, default=0.5, help=text)
    shell.add_seed(built, "of the splits")
    return built


def surface_text(result: Identified, data: Normalised, arguments: argparse.Namespace) -> str:
    """The text of the file that states an identified limit surface and its origin."""
    surface = result.fit.surface
    values: dict[str, Any] = {"rho_mm": surface.rho_mm}
    if isinstance(surface, LimitSurface):
        values["ellipsoid"] = surface.A
    else:
        values |= {"quartic": surface.coefficients, "certificate": surface.certificate}
    logs = [str(path) for path in (*arguments.logs, *arguments.pairs)]
    chosen = {name: getattr(arguments, name) for name in ("splits", "train_share", "seed")}
    facts = {"logs": logs, "pairs": len(data.F), **chosen, **_figures(result)}
    del facts["kind"]
    if facts["friction_n"] is None:
        del facts["friction_n"]
    return surface_file.dumps(values, facts)


def _figures(result: Identified) -> dict[str, Any]:
    errors = np.degrees(result.errors_rad)
    return {
        "kind": result.kind,
        "held_out_error_deg": round(float(errors.mean()), 3),
        "held_out_error_sd_deg": round(float(errors.std()), 3),
        "held_out_error_range_deg": [round(float(errors.min()), 3), round(float(errors.max()), 3)],
        "fit_error_deg": round(math.degrees(result.fit_error_rad), 3),
        "friction_n": None if result.fit.friction_n is None else round(result.fit.friction_n, 4),
        "ridge_pairs": result.fit.ridge,
    }


def _print(
    data: Normalised, outcome: Sequence[Identified], best: Identified, arguments: argparse.Namespace
) -> None:
    pairs, against = len(data.F), int(((data.F * data.V).sum(axis=1) <= 0.0).sum())
    written = [str(path) for path in (arguments.output, arguments.figure) if path is not None]
    figures = {
        "pairs": pairs,
        "against_motion": against,
        "splits": arguments.splits,
        "surfaces": [_figures(each) for each in outcome],
        "best": best.kind,
        "written": written,
    }
    train = round(arguments.train_share * pairs)
    newtons = best.fit.friction_n
    friction = "directions only" if newtons is None else f"friction {newtons:.2f} N"
    lines = [
        f"{pairs} pushes, rho {arguments.rho_mm:g} mm, {friction}",
        f"held-out twist error over {arguments.splits} random splits, {train} pushes to fit each:",
    ]
    for result in outcome:
        errors = np.degrees(result.errors_rad)
        lines.append(
            f"  {result.kind:9} {errors.mean():5.1f} deg (standard deviation {errors.std():.1f}, from "
            f"{errors.min():.1f} to {errors.max():.1f}); {math.degrees(result.fit_error_rad):.1f} deg on all "
            "pushes when fitted to all"
        )
    if written:
        kind = f": the {best.kind}" if arguments.output else ""
        lines.append(f"wrote {' and '.join(written)}{kind}")
    shell.answer(arguments.json, figures, *lines)
    if against and not arguments.json:
        words = f"in {against} of {pairs} pushes the wrench works against the motion; check signs and frames"
        print(f"{NAME}: {words}", file=sys.stderr)


def _share(text: str) -> float:
    """Parses a number between 0 and 1 for argparse."""
    value = number(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1")
    return value


main = shell.main_of(parser, _identify)
