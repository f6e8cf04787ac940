"""The options --bound and --bound-dense, for a lower bound: no plan of equal success needs fewer squeezes."""

import argparse

from planner.bound.certificate import MOST_PARTS, PARTS, Certificate, certify
from planner.job.model import Job
from planner.work.progress import Report, silent
from runtime.shell import command
from runtime.table import Table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options --bound and --bound-dense; `bound_of` reads them."""
    text = (
        "prove a lower bound on the squeezes of any plan that is as good, from a sample of PARTS parts "
        f"(default: {PARTS}); takes seconds to minutes; more parts tighten the bound"
    )
    parser.add_argument("--bound", nargs="?", const=PARTS, type=_parts, metavar="PARTS", help=text)
    text = "the same for plans that may also squeeze every 15 degrees and off centre"
    parser.add_argument("--bound-dense", action="store_true", help=text)


def bound_of(
    arguments: argparse.Namespace,
    job: Job,
    table: Table,
    workers: int | None = None,
    report: Report = silent,
) -> Certificate | None:
    """Proves a lower bound on squeezes if the options ask for one, else returns None.

    The arguments after `arguments` are those of `certify`.
    """
    if not (arguments.bound or arguments.bound_dense):
        return None
    return certify(job, table, arguments.bound or PARTS, arguments.bound_dense, workers, report)


def _parts(text: str) -> int:
    parts = command.positive_int(text)
    if parts > MOST_PARTS:
        raise argparse.ArgumentTypeError(f"{parts} is more than {MOST_PARTS}; give fewer")
    return parts
