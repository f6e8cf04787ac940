"""plan-evaluate: a table against a world, over many fresh trials."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from planner.cli import shell
from planner.errors import UsageError
from planner.evaluation import text
from planner.evaluation.cases import believed_cases, standard_cases
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import Line, evaluate, sweep, worst_of
from planner.evaluation.leaves import confusions, identities, reliability, worst
from planner.evaluation.ppm import Findings, Study, Sums, continued, copies_of, keep, resumed
from planner.evaluation.strangers import family, strangers
from planner.evaluation.trials import Program
from planner.job.model import Job
from planner.job.overrides import changes_of
from planner.work.scheduler import Scheduler, scheduler_of
from planner.world import ContactWorlds, Worlds, supply
from runtime.shell.command import Parser, natural, number, positive, positive_int
from runtime.shell.files import usable
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.table import Table

NAME = "plan-evaluate"
DEFAULT_TRIALS = 20_000
BELIEVED_TRIALS = 4_000  # in each world that the job believes in
DEFAULT_PPM_TRIALS = 1_000_000


def parser() -> Parser:
    """The command's arguments."""
    built = shell.parser(
        NAME,
        "Run a decision table on many parts in a world, and count how often it finds them.",
        f"{NAME} trees/rectangle/rectangle.msgpack --world-set friction.finger_part_max=0.8",
        f"{NAME} trees/rectangle/rectangle.msgpack --sweep",
        f"{NAME} trees/rectangle/rectangle.msgpack --ppm --trials 10000000 --resume study.json",
    )
    shell.add_table(built)
    built.add_argument(
        "--trials", type=positive_int, metavar="N",
        help=f"parts squeezed (default: {DEFAULT_TRIALS}, with --ppm {DEFAULT_PPM_TRIALS})",
    )  # fmt: skip
    built.add_argument("--seed", type=natural, default=0, help="of the trials (default: %(default)s)")
    built.add_argument(
        "--worst", type=natural, default=3, metavar="N",
        help="how many of the worst errors to show (default: %(default)s)",
    )  # fmt: skip
    built.add_argument(
        "--strangers", action="store_true",
        help="also parts that do not belong there: each part a tenth smaller and larger, a disc, a rectangle",
    )  # fmt: skip
    shell.add_scheduler(built)
    _add_rare(built.add_argument_group("wrong answers in parts per million"))
    _add_world(built.add_argument_group("the world, where it is not what the plan believes"))
    return built


def _add_rare(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--ppm", action="store_true",
        help="count confident wrong answers of the table and of each leaf, with upper bounds; parts "
        "that come to rare nodes are followed as several copies",
    )  # fmt: skip
    group.add_argument(
        "--until", type=positive, metavar="PPM",
        help="end as soon as the rate is shown to be below this, or above it",
    )  # fmt: skip
    group.add_argument(
        "--resume", type=Path, metavar="FILE.json",
        help="go on with the study in this file, and keep it there; it is begun where there is none",
    )  # fmt: skip


def _add_world(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    add(
        "--world", default=DEFAULT_WORLD, metavar="MODULE:FACTORY",
        help="where the parts are squeezed (default: %(default)s)",
    )  # fmt: skip
    add(
        "--world-copies", action="store_true",
        help="make the world anew for every 1000 trials, with a seed of its own, so that workers share them",
    )  # fmt: skip
    add(
        "--world-set", action="append", default=[], metavar="SECTION.KEY=VALUE",
        help="a value of the job that the world gets instead, such as pressure.kind=uniform; repeatable",
    )  # fmt: skip
    add("--sweep", action="store_true", help="a standard set of such worlds, one line each; no other change")
    add("--encoder-offset-mm", type=number, default=0.0, metavar="MM", help="added to every width")
    add(
        "--placement-error-mm", type=_spread, default=0.0, metavar="MM",
        help="standard deviation of the hand's x and y, drawn for every squeeze",
    )  # fmt: skip
    add("--placement-error-deg", type=_spread, default=0.0, metavar="DEG", help="and of its angle")
    add(
        "--placement-bias-mm", type=number, nargs=2, default=(0.0, 0.0), metavar=("X", "Y"),
        help="constant error of the hand's place in the world",
    )  # fmt: skip
    add("--placement-bias-deg", type=number, default=0.0, metavar="DEG", help="and of its angle")


def _evaluate(arguments: argparse.Namespace) -> None:
    _check_usage(arguments)
    (table, _, _), job = shell.loaded(arguments)
    study = _rare if arguments.ppm else _sweep if arguments.sweep else _single
    with scheduler_of(arguments.scheduler, arguments.workers) as scheduler:
        study(table, job, scheduler, arguments)


def _single(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> None:
    """One world, looked at closely."""
    real = job.replaced("the job with --world-set", **changes_of(arguments.world_set))
    world = supply(arguments.world, real, arguments.seed, arguments.world_copies)
    with shell.progress(arguments.json) as report:
        trials, seed = arguments.trials or DEFAULT_TRIALS, arguments.seed
        evaluation = evaluate(table, real, world, trials, seed, scheduler, _disturbance(arguments), report)
        believed = worst_of(_believed(table, job, scheduler, arguments))
        strange = list(
            strangers(
                table, real, (*real.strangers, *(family(real) if arguments.strangers else ())), evaluation,
                lambda other: supply(arguments.world, other, seed, arguments.world_copies),
                trials, seed, scheduler, _disturbance(arguments),
            )
        )  # fmt: skip
    outcome = reliability(table, evaluation)
    confused, mistakes = confusions(table, evaluation), worst(table, evaluation, arguments.worst)
    figures = {
        **evaluation.summary(),
        "worst_believed": believed and {"world": believed.case.name, **believed.evaluation.summary()},
        **({"identities": identities(table, evaluation).figures()} if table.hypotheses else {}),
        **({"strangers": [each.figures() for each in strange]} if strange else {}),
        "reliability": outcome.figures(),
        "confusions": [row._asdict() for row in confused],
        "worst": [row.figures() for row in mistakes],
    }
    shell.answer(
        arguments.json,
        figures,
        *([text.worst_world(believed.case.name, believed.evaluation)] if believed else []),
        *text.overview(evaluation, _name_of_world(arguments)),
        *(text.named(identities(table, evaluation)) if table.hypotheses else ()),
        *(line for each in strange for line in each.lines()),
        *text.predictions(table, outcome),
        *text.taken_for(confused),
        *text.furthest(mistakes),
    )


def _believed(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> Iterator[Line]:
    """The table in each world that its job believes in, where the contact world stands for them."""
    cases = believed_cases(job) if arguments.world == DEFAULT_WORLD else []
    trials, seed = min(arguments.trials or BELIEVED_TRIALS, BELIEVED_TRIALS), arguments.seed
    return sweep(table, job, cases, lambda real: ContactWorlds.of_job(real, seed), trials, seed, scheduler)


def _rare(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> None:
    """Wrong answers in parts per million."""
    real = job.replaced("the job with --world-set", **changes_of(arguments.world_set))
    worlds = supply(arguments.world, real, arguments.seed, copies=True)
    assert isinstance(worlds, Worlds)
    study = Study(Program.of(table), real, worlds, arguments.seed, copies_of(table), _disturbance(arguments))
    wanted, kept = arguments.trials or DEFAULT_PPM_TRIALS, arguments.resume
    identity = study.identity(_name_of_world(arguments))
    sums = Sums.none(len(table.leaves)) if kept is None else resumed(kept, identity, len(table.leaves))
    with shell.progress(arguments.json) as report:
        report("evaluate", sums.parts, wanted)
        for done in continued(study, sums, wanted, scheduler):
            sums = done
            report("evaluate", sums.parts, wanted)
            if kept is not None:
                keep(kept, identity, sums)
            if arguments.until is not None and Findings.of(sums).decided(arguments.until):
                break
    found = Findings.of(sums)
    told = f"{sums.parts} parts in {_name_of_world(arguments)}"
    shell.answer(arguments.json, found.figures(), told, *found.lines(arguments.until))


def _check_usage(arguments: argparse.Namespace) -> None:
    if arguments.ppm and arguments.sweep:
        raise UsageError("--ppm and --sweep are two studies; run one after the other")
    if arguments.strangers and (arguments.ppm or arguments.sweep):
        raise UsageError("--strangers come into one world; leave out --ppm and --sweep")
    for name in ("until", "resume"):
        if getattr(arguments, name) is not None and not arguments.ppm:
            raise UsageError(f"--{name} is of --ppm; add it")
    if arguments.resume is not None:
        usable(arguments.resume, arguments.tree, arguments.job)


def _sweep(table: Table, job: Job, scheduler: Scheduler, arguments: argparse.Namespace) -> None:
    if arguments.world_set or _disturbance(arguments) != Disturbance():
        raise UsageError(
            "--sweep has worlds of its own; leave out --world-set, --encoder-... and --placement-..."
        )
    if not arguments.json:
        print(text.SWEEP_HEAD)
    told = []
    for case, found in sweep(
        table, job, standard_cases(job),
        lambda real: supply(arguments.world, real, arguments.seed, arguments.world_copies),
        arguments.trials or DEFAULT_TRIALS, arguments.seed, scheduler,
    ):  # fmt: skip
        told.append({"world": case.name, "set": case.stated(), **found.summary()})
        if not arguments.json:
            print(text.sweep_row(case.name, found), flush=True)
    if arguments.json:
        shell.answer(True, {"worlds": told})


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
    """A standard deviation, for argparse."""
    spread = number(value)
    if spread < 0.0:
        raise argparse.ArgumentTypeError(f"{value} is negative")
    return spread


main = shell.main_of(parser, _evaluate)
