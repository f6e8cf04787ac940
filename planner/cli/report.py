"""plan-report: a table as one self-contained HTML page."""

import argparse
from pathlib import Path

from planner.cli import bounds, shell
from planner.job import model as job_file
from planner.report import comparison, dossier, run_log
from planner.report.run_log import RunLog
from runtime.shell.command import Parser
from runtime.shell.errors import UsageError
from runtime.shell.files import fitting, usable, write

NAME = "plan-report"
MAX_TRIALS = 1_000_000


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Write a decision table as one page for a browser: the tree to walk through, how good it is, where\n"
        "it is in doubt, and the job it was made from. Nothing is loaded from the network.",
        f"{NAME} trees/rectangle/rectangle.msgpack -o report.html --journal journal.jsonl",
        f"{NAME} tree.msgpack -o report.html --compare tree-2.msgpack",
        f"{NAME} tree.msgpack -o sheet.html --sheet",
    )
    add = built.add_argument
    shell.add_table(built)
    shell.add_output(built, "PAGE.html", "the page")
    text = "lay the runs of this journal over the tree"
    add("--journal", type=Path, metavar="J.jsonl", help=text)
    text = "compare the plan with another table or, with --journal, its runs with those of another journal"
    add("--compare", type=Path, metavar="FILE", help=text)
    text = "a short version for a customer: two printed sheets"
    add("--sheet", action="store_true", help=text)
    text = f"also evaluate the table in this world, with {dossier.OTHER_TRIALS} parts: one more row"
    add("--world", metavar="MODULE:FACTORY", help=text)
    shell.add_takt(built)
    bounds.add_options(built)
    shell.add_trials(built, dossier.TRIALS, "parts sent through the table to draw its beliefs")
    shell.add_seed(built, "of these parts")
    return built


def _report(arguments: argparse.Namespace) -> None:
    read = () if arguments.job is None else job_file.files(arguments.job)
    output = fitting(arguments.output, "a page for a browser", ".html")
    usable(output, arguments.tree, arguments.journal, arguments.compare, *read)
    if arguments.trials > MAX_TRIALS:
        most = f"more than {MAX_TRIALS}; a picture needs less"
        raise UsageError(f"--trials {arguments.trials} is {most}")
    (table, data, digest), job = shell.loaded(arguments)
    if arguments.bound or arguments.bound_dense:
        shell.check_one_part(table.hypotheses, str(arguments.tree), "--bound")
        shell.check_squeezes_alone(table, str(arguments.tree), "--bound")
    log = run_log.read(arguments.journal, digest) if arguments.journal else None
    bound = bounds.bound_of(arguments, job, table)
    plan = comparison.Plan(arguments.tree.name, table, job)
    compared = None if arguments.compare is None else _compared(arguments, plan, log, digest)
    source = dossier.Source(arguments.tree.name, data, log, bound, arguments.takt, compared)
    trials, seed, world = arguments.trials, arguments.seed, arguments.world
    write(output, dossier.page(table, job, source, trials, seed, world, sheet=arguments.sheet))
    size, nodes, leaves = output.stat().st_size, len(table.nodes), len(table.leaves)
    figures = {"output": str(output), "bytes": size, "nodes": nodes, "leaves": leaves}
    message = f"drew {nodes} nodes and {leaves} leaves; wrote {output}, {size:,} bytes"
    shell.answer(arguments.json, figures, message)


def _compared(
    arguments: argparse.Namespace, plan: comparison.Plan, log: RunLog | None, digest: str
) -> comparison.Comparison:
    other = arguments.compare
    if log is not None:
        runs = (arguments.journal.name, log), (other.name, run_log.read(other, digest))
        return comparison.of_runs(*runs)
    (table, _, _), job = shell.loaded(argparse.Namespace(tree=other, job=None))
    return comparison.of_plans(plan, comparison.Plan(other.name, table, job), arguments.trials)


main = shell.main_of(parser, _report)
