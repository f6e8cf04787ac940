"""plan-evaluate: a table against a world, over many fresh trials."""

from __future__ import annotations

import sys
from pathlib import Path

from planner import job as job_file
from planner.cli import shell
from planner.errors import InputFileError
from planner.evaluate import Evaluation, evaluate
from planner.job import Job
from planner.worlds import DEFAULT_WORLD, load_world
from runtime.table import Table, load

NAME = "plan-evaluate"
DEFAULT_TRIALS = 20_000


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = shell.parser(
        NAME,
        "Run a decision table on many parts in a world, and count how often it finds them.",
        f"{NAME} trees/rectangle/rectangle.msgpack --trials 20000",
    )
    parser.add_argument("tree", type=Path, metavar="TREE.msgpack", help="the table")
    parser.add_argument("--job", type=Path, help="the job file, for a table compiled with --strip")
    parser.add_argument(
        "--world", default=DEFAULT_WORLD, metavar="MODULE:FACTORY",
        help="where the parts are squeezed (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--trials", type=shell.positive, default=DEFAULT_TRIALS, help="(default: %(default)s)"
    )
    parser.add_argument("--seed", type=shell.natural, default=0, help="of the trials (default: %(default)s)")
    arguments = parser.parse_args(argv)

    def body() -> int:
        table = load(arguments.tree)
        job = _job_of(table, arguments.tree, arguments.job)
        world = load_world(arguments.world, job, arguments.seed)
        evaluation = evaluate(table, job, world, arguments.trials, arguments.seed)
        if arguments.json:
            shell.print_json(evaluation.summary())
        else:
            print(_text(evaluation, arguments.world))
        return 0

    return shell.run(NAME, arguments.debug, body)


def _job_of(table: Table, path: Path, job_path: Path | None) -> Job:
    """The job a table was compiled from: its own copy, or a file with the same digest."""
    if job_path is None:
        if table.job is None:
            raise InputFileError("holds no job (--strip); name its job file with --job", where=str(path))
        return job_file.from_canonical(table.job, f"{path} (embedded job)")
    job = job_file.load(job_path)
    if job.digest() != table.job_digest:
        raise InputFileError(
            f"is not the job that {path} was compiled from; compile it again", where=str(job_path)
        )
    return job


def _text(evaluation: Evaluation, world: str) -> str:
    figures = evaluation.summary()
    low, high = figures["success_ci95"]
    return "\n".join(
        [
            f"{figures['trials']} trials in {world}",
            f"success    {figures['success_rate']:.4f}  (95 % interval {low:.4f} to {high:.4f})",
            f"wrong      {figures['wrong_rate']:.4f}  confident, but not within the goal",
            f"rejected   {figures['reject_rate']:.4f}",
            f"unresolved {figures['unresolved_rate']:.4f}",
            f"squeezes   {figures['mean_squeezes']:.2f} on average, {figures['max_squeezes']} at most",
            f"seconds    {figures['mean_seconds']:.1f} a part, estimated",
            f"crashes    {figures['crashes']}",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
