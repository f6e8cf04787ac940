"""plan-expect: expected encoder readings at each node of a table, for the charts of grasp-audit."""

import argparse
import json

from planner.cli import shell
from planner.evaluation.expectation import expected
from planner.job import model as job_file
from runtime.shell.command import Parser
from runtime.shell.files import fitting, usable, write

NAME = "plan-expect"
DEFAULT_TRIALS = 100_000


def parser() -> Parser:
    """The parser of the command line."""
    command = shell.parser(
        NAME,
        "Simulate the encoder's readings at each node of a table, as planned and at other frictions: "
        "grasp-audit report --expected compares journals with them, and detects a change of friction early.",
        f"{NAME} trees/rectangle/rectangle.msgpack -o expected.json",
    )
    shell.add_table(command)
    shell.add_output(command, "EXPECTED.json", "the file to write")
    shell.add_trials(command, DEFAULT_TRIALS, "parts squeezed in each world")
    shell.add_seed(command, "of the trials")
    shell.add_scheduler(command)
    return command


def _expect(arguments: argparse.Namespace) -> None:
    read = () if arguments.job is None else job_file.files(arguments.job)
    fitting(usable(arguments.output, arguments.tree, *read), "expected readings", ".json")
    (table, _, digest), job = shell.loaded(arguments)
    with shell.scheduler(arguments) as scheduler, shell.progress(arguments.json) as report:
        worlds = list(expected(table, job, arguments.trials, arguments.seed, scheduler, report))
    record = {
        "kind": "expected readings",
        "version": 2,
        "bins": table.gripper.bins,
        "table_sha256": digest,
        "trials": arguments.trials,
        "seed": arguments.seed,
        "worlds": worlds,
    }
    write(arguments.output, json.dumps(record, separators=(",", ":")) + "\n")
    names = [world["name"] for world in worlds]
    figures = {"worlds": names, "trials": arguments.trials, "written": str(arguments.output)}
    lines = f"{arguments.trials} parts each: {', '.join(names)}", f"wrote {arguments.output}"
    shell.answer(arguments.json, figures, *lines)


main = shell.main_of(parser, _expect)
