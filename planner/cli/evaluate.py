"""plan-evaluate: runs a table on many simulated parts in a world, and counts how they end."""

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from planner.cli import course, shell
from planner.evaluation import foreign, leaves
from planner.evaluation.cases import believed_cases, standard_cases
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate, sweep, worst_of
from planner.evaluation.outcome import Evaluation
from planner.evaluation.ppm import Findings, Study, Sums, continued, copies_of, keep, resumed
from planner.evaluation.shares import shares_of
from planner.evaluation.trials import Program
from planner.job.model import Job
from planner.job.overrides import changes_of
from planner.work.scheduler import Scheduler
from planner.world import World, Worlds, supply
from runtime.shell.command import Parser, natural, number, positive_int, tell
from runtime.shell.errors import UsageError
from runtime.shell.exit_codes import ExitCode
from runtime.shell.files import usable
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.table import Table, takt_text

NAME = "plan-evaluate"
DEFAULT_TRIALS = 20_000
BELIEVED_TRIALS = 4_000  # trials in each world that the job believes possible
DEFAULT_PPM_TRIALS = 1_000_000
MOST_ROWS = 8
MOST_ERROR = 1000.0  # largest error of a cell [mm or degrees]
WITHOUT_EFFECT = frozenset(
    {"actions", "delivery", "goal", "search", "seed"}
)  # sections, on a world
RATES = "wrong {wrong_rate:.2%}, success {success_rate:.2%} of {trials} parts"


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Run a decision table on many parts in a world, and count how often it locates them.",
        f"{NAME} trees/rectangle/rectangle.msgpack --world-set friction.finger_part_max=0.8",
        f"{NAME} trees/rectangle/rectangle.msgpack --sweep",
        f"{NAME} trees/rectangle/rectangle.msgpack --ppm --trials 10000000 --resume study.json",
    )
    shell.add_table(built)
    text = f"parts squeezed (default: {DEFAULT_TRIALS}, with --ppm {DEFAULT_PPM_TRIALS})"
    built.add_argument("--trials", type=positive_int, metavar="N", help=text)
    shell.add_takt(built)
    shell.add_seed(built, "of the trials")
    text = "how many of the worst errors to show (default: %(default)s)"
    built.add_argument("--worst", type=natural, default=3, metavar="N", help=text)
    text = "also squeeze foreign parts: each part a tenth smaller and larger, a disc, a rectangle"
    built.add_argument("--foreign-parts", action="store_true", help=text)
    shell.add_scheduler(built)
    _add_rare(built.add_argument_group("wrong answers in parts per million"))
    _add_world(built.add_argument_group("the world, where it is not what the plan believes"))
    return built


def _add_rare(group: argparse._ArgumentGroup) -> None:
    copies = "parts that come to rare nodes are followed as several copies"
    text = (
        f"count confident wrong answers of the table and of each leaf, with upper bounds; {copies}"
    )
    group.add_argument("--ppm", action="store_true", help=text)
    text = "continue the study in this file, or begin it there"
    group.add_argument("--resume", type=Path, metavar="FILE.json", help=text)


def _add_world(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    text = "world in which the parts are squeezed (default: %(default)s)"
    add("--world", default=DEFAULT_WORLD, metavar="MODULE:FACTORY", help=text)
    text = "make a new world with its own seed for every 1000 trials, so that workers share them"
    add("--world-copies", action="store_true", help=text)
    text = "override a value of the job in the world, such as pressure.kind=uniform; repeatable"
    add("--world-set", action="append", default=[], metavar="SECTION.KEY=VALUE", help=text)
    text = "evaluate in a standard set of worlds, one line each; without other changes of the world"
    add("--sweep", action="store_true", help=text)
    add("--encoder-offset-mm", type=_error, default=0.0, metavar="MM", help="added to every width")
    text = "standard deviation of the hand's x and y, drawn for every squeeze"
    add("--placement-error-mm", type=_spread, default=0.0, metavar="MM", help=text)
    add("--placement-error-deg", type=_spread, default=0.0, metavar="DEG", help="and of its angle")
    place: dict[str, Any] = {"nargs": 2, "default": (0.0, 0.0), "metavar": ("X", "Y")}
    text = "constant error of the hand's place in the world"
    add("--placement-bias-mm", type=_error, help=text, **place)
    add("--placement-bias-deg", type=_error, default=0.0, metavar="DEG", help="and of its angle")


def _evaluate(arguments: argparse.Namespace) -> int | None:
    shell.refuse(_mistakes(arguments))
    if arguments.resume is not None:
        usable(arguments.resume, arguments.tree, arguments.job)
    (table, _, _), job = shell.loaded(arguments)
    study: Callable[..., int | None] = _single
    if arguments.ppm or arguments.sweep:
        study = _rare if arguments.ppm else _sweep
    with shell.scheduler(arguments) as scheduler:
        return study(table, job, scheduler, arguments)


def _single(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> None:
    """Evaluates the table in one world, and prints a detailed answer."""
    real = _real(job, arguments)
    worlds, cell = _worlds_of(arguments), _disturbance(arguments)
    trials, seed = arguments.trials or DEFAULT_TRIALS, arguments.seed
    with shell.progress(arguments.json) as report:
        evaluation = evaluate(table, real, worlds(real), trials, seed, scheduler, cell, report)
        # Only the contact world can represent the worlds that the job believes possible.
        cases = believed_cases(job) if arguments.world == DEFAULT_WORLD else []
        fewer = min(trials, BELIEVED_TRIALS)
        believed = worst_of(sweep(table, job, cases, fewer, seed, scheduler))
        others = real.foreign_parts
        if arguments.foreign_parts:
            others = (*others, *foreign.family(real))

        def evaluated(part: Job) -> Evaluation:
            return evaluate(table, part, worlds(part), trials, seed, scheduler, cell)

        tried = list(foreign.tried(table, real, evaluation, others, evaluated))
    outcome, confused = leaves.reliability(table, evaluation), leaves.confusions(table, evaluation)
    named = bool(table.hypotheses) and table.goal.identify
    known = leaves.identities(table, evaluation) if named else None
    mistakes = leaves.worst(table, evaluation, arguments.worst)
    worst = believed and {"world": believed.case.name, **believed.evaluation.summary()}
    figures = {
        **evaluation.summary(arguments.takt),
        "worst_believed": worst,
        **({"identities": known.figures()} if known else {}),
        **({"foreign_parts": [each.figures() for each in tried]} if tried else {}),
        "reliability": outcome.figures(),
        "confusions": [row._asdict() for row in confused],
        "worst": [row.figures() for row in mistakes],
    }
    lines: list[str] = []
    if worst:
        rates = RATES.format(**worst)
        lines.append(f"worst      {rates} in the worst believed world: {worst['world']}")
    shell.answer(
        arguments.json,
        figures,
        *lines,
        *_overview(evaluation, _name_of_world(arguments), arguments.takt),
        *(_named(known) if known else ()),
        *(line for each in tried for line in each.lines()),
        *_predictions(table, outcome),
        *_taken_for(confused),
        *_furthest(mistakes),
    )


def _rare(
    table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace
) -> int | None:
    real = _real(job, arguments)
    worlds = supply(arguments.world, real, arguments.seed, copies=True)
    assert isinstance(worlds, Worlds)
    cell = _disturbance(arguments)
    study = Study(Program.of(table), real, worlds, arguments.seed, copies_of(table), cell)
    wanted, kept = arguments.trials or DEFAULT_PPM_TRIALS, arguments.resume
    identity = study.identity(_name_of_world(arguments))
    sums = Sums.none(len(table.leaves))
    if kept is not None:
        sums = resumed(kept, identity, len(table.leaves))
    with shell.progress(arguments.json, course.counted) as report:
        report("evaluate", sums.parts, wanted)
        try:
            for done in continued(study, sums, wanted, scheduler):
                sums = done
                report("evaluate", sums.parts, wanted)
                if kept is not None:
                    keep(kept, identity, sums)
        except KeyboardInterrupt:
            if kept is None:
                raise
            tell(NAME, f"interrupted; the same command continues after the parts that {kept} keeps")
            return ExitCode.INTERRUPTED
    result = Findings.of(sums)
    message = f"{sums.parts} parts in {_name_of_world(arguments)}"
    shell.answer(arguments.json, result.figures(), message, *result.lines())
    return None


def _mistakes(arguments: argparse.Namespace) -> Iterator[str]:
    if arguments.ppm and arguments.sweep:
        yield "--ppm and --sweep are two studies; run one after the other"
    if arguments.foreign_parts and (arguments.ppm or arguments.sweep):
        yield "--foreign-parts come into one world; leave out --ppm and --sweep"
    if arguments.resume is not None and not arguments.ppm:
        yield "--resume continues a study of --ppm; add --ppm"
    if arguments.takt is not None and arguments.ppm:
        yield "--ppm counts wrong answers and times nothing; leave out --takt"
    if arguments.sweep and (arguments.world_set or _disturbance(arguments) != Disturbance()):
        changes = "--world-set, --encoder-... and --placement-..."
        yield f"--sweep has worlds of its own; leave out {changes}"


def _sweep(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> None:
    say = shell.printer(arguments.json)
    say(SWEEP_HEAD)
    lines = []
    trials = arguments.trials or DEFAULT_TRIALS
    worlds = _worlds_of(arguments)
    cases = standard_cases(job)
    for case, result in sweep(table, job, cases, trials, arguments.seed, scheduler, worlds=worlds):
        lines.append({"world": case.name, "set": case.stated(), **result.summary(arguments.takt)})
        say(sweep_row(case.name, result, arguments.takt), flush=True)
    if arguments.json:
        shell.answer(True, {"worlds": lines})


def _real(job: Job, arguments: argparse.Namespace) -> Job:
    """The job of the world: that of the table with --world-set.

    Raises:
        UsageError: a change has no effect on a world, or leads to another number of parts.
    """
    changes = changes_of(arguments.world_set)
    if useless := sorted(changes.keys() & WITHOUT_EFFECT):
        problem = f"--world-set {useless[0]}: no world depends on it"
        raise UsageError(f"{problem}; change the job, and compile it")
    real = job.replaced("the job with --world-set", **changes)
    if len(real.alone) != len(job.alone):
        problem = f"--world-set leads to {len(real.alone)} parts, the table knows {len(job.alone)}"
        raise UsageError(f"{problem}; change the job, and compile it")
    return real


def _worlds_of(arguments: argparse.Namespace) -> Callable[[Job], World | Worlds]:
    return lambda real: supply(arguments.world, real, arguments.seed, arguments.world_copies)


def _disturbance(arguments: argparse.Namespace) -> Disturbance:
    return Disturbance(
        encoder_offset_mm=arguments.encoder_offset_mm,
        placement_mm=arguments.placement_error_mm,
        placement_deg=arguments.placement_error_deg,
        bias_mm=tuple(arguments.placement_bias_mm),
        bias_deg=arguments.placement_bias_deg,
    )


def _name_of_world(arguments: argparse.Namespace) -> str:
    stated = asdict(_disturbance(arguments)).items()
    errors = [f"{name} {value}" for name, value in stated if value not in (0.0, (0.0, 0.0))]
    return ", ".join([arguments.world, *arguments.world_set, *errors])


def _spread(value: str) -> float:
    """Parses a standard deviation, which must not be negative, for argparse."""
    spread = _error(value)
    if spread < 0.0:
        raise argparse.ArgumentTypeError(f"{value} is negative")
    return spread


def _error(value: str) -> float:
    """Parses an error of a cell [mm or degrees], for argparse."""
    error = number(value)
    if abs(error) > MOST_ERROR:
        raise argparse.ArgumentTypeError(f"{value} is beyond {MOST_ERROR:g}")
    return error


def _overview(evaluation: Evaluation, world: str, takt_s: float | None) -> list[str]:
    figures = evaluation.summary(takt_s)
    low, high = figures["success_ci95"]
    taken, most = np.bincount(evaluation.squeezes), figures["max_squeezes"]
    errors = []
    if error := figures["error_mm"]:
        within = f"95 % within {error['p95']:.2f} mm"
        errors = [f"error      {error['median']:7.2f}  mm median where resolved, {within}"]
    takt = "" if takt_s is None else f"; {takt_text(figures)}"
    counts = enumerate(taken / taken.sum())
    spread = ", ".join(f"{k}: {share:.1%}" for k, share in counts if share > 0)
    shares = shares_of(figures)
    return [
        f"{figures['trials']} parts in {world}",
        f"success    {shares.located:6.2f}%  95 % interval {low:.2%} to {high:.2%}",
        f"wrong      {shares.wrong:6.2f}%  confident, but not within the goal",
        f"rejected   {shares.rejected:6.2f}%",
        f"unresolved {shares.unresolved:6.2f}%",
        f"squeezes   {figures['mean_squeezes']:7.2f}  a part, up to {most} here ({spread})",
        f"seconds    {figures['seconds_mean']:7.1f}  a part, 95 % within {figures['seconds_p95']:.1f}{takt}",
        *errors,
        f"crashes    {shares.crashed:6.2f}%  {figures['crashes']} parts that a finger came down on: failures",
    ]


def _named(identities: leaves.Identities) -> list[str]:
    """Lines on the names given to parts: the share of right names, and each confusion with its count."""
    figures = identities.figures()
    message = f"of the parts that were named ({figures['named_rate']:.2%})"
    lines = [f"{identities.right:7.2%}  right, {message}"]
    for truth, row in zip(identities.names, identities.named, strict=True):
        for name, n in zip(identities.names, row, strict=False):
            if n and name != truth:
                lines.append(f"{n} of {row.sum()} {truth} were named {name}")
    return _block("identity", lines)


def _predictions(table: Table, outcome: leaves.Reliability) -> list[str]:
    """Lines that state how many leaves succeed as often as the table predicts, and list the others."""
    held, total = sum(row.holds for row in outcome.rows), len(outcome.rows)
    if total == 0:
        few = f"no leaf of {len(table.leaves)} has {leaves.LEAST_VISITS} visits"
        return _block("leaves", [f"{few}; raise --trials"])
    share = f"{held} of {total} with {leaves.LEAST_VISITS} visits or more"
    lines = [f"{share} do as the table predicts ({outcome.share:.0%})"]
    failed = sorted((row for row in outcome.rows if not row.holds), key=lambda row: -row.visits)
    for row in failed[:MOST_ROWS]:
        low, high = row.interval95
        observed = f"leaf {row.leaf}: {row.observed:.2%} of {row.visits}"
        interval = f"with 95 % between {low:.2%} and {high:.2%}"
        lines.append(f"{observed}, predicted {row.predicted:.2%}, {interval}")
    return _block("leaves", lines, len(failed))


def _taken_for(confused: list[leaves.Confusion]) -> list[str]:
    """Lines that count the parts which ended at one leaf, but lay at another leaf's pose or at no leaf's."""
    lines: list[str] = []
    for row in confused[:MOST_ROWS]:
        truth = "where no leaf is" if row.truth == leaves.NO_LEAF else f"at leaf {row.truth}"
        claim = "" if row.resolved else ", unresolved"
        lines.append(f"for leaf {row.leaf}{claim}: {row.trials} parts that lay {truth}")
    return _block("taken", lines, len(confused))


def _furthest(mistakes: list[leaves.Mistake]) -> list[str]:
    """Lines on the parts with the largest errors, each with the part's path through the table."""
    lines: list[str] = []
    for row in mistakes:
        x, y, theta = row.initial_pose
        path = " > ".join(map(str, row.path))
        widths = ", ".join(f"{width:.2f}" for width in row.widths_mm)
        lines.append(
            f"{row.error_mm:.1f} mm off, from ({x:.1f}, {y:.1f}) mm at {math.degrees(theta):.0f} deg, "
            f"nodes {path} > leaf {row.leaf}, widths {widths} mm"
        )
    return _block("worst", lines)


SWEEP_HEAD = f"{'world':31s} success    wrong reject unresolved squeezes seconds"


def sweep_row(world: str, evaluation: Evaluation, takt_s: float | None) -> str:
    """The figures of one world as a row under `SWEEP_HEAD`.

    With a takt, the row also states how many parts are done in time.
    """
    figures = evaluation.summary(takt_s)
    shares, takt = shares_of(figures), "" if takt_s is None else f"; {takt_text(figures)}"
    return (
        f"{world:31s} {shares.located:6.2f}% {shares.wrong:7.2f}% "
        f"{shares.rejected:5.2f}% {shares.unresolved:9.2f}% {figures['mean_squeezes']:8.2f} "
        f"{figures['seconds_mean']:7.1f}{takt}"
    )


def _block(head: str, lines: list[str], rows: int = 0) -> list[str]:
    """Indents lines beside a head.

    `rows` is the number of all rows, of which at most `MOST_ROWS` are among the lines. If it is greater, a
    further line states how many rows were left out.
    """
    more = [f"and {rows - MOST_ROWS} more; see --json"] if rows > MOST_ROWS else []
    return [f"{head if k == 0 else '':11s}{line}" for k, line in enumerate([*lines, *more])]


main = shell.main_of(parser, _evaluate)
