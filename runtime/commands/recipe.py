"""A recipe: a checked table with all that a run of it needs, such as the options of the run."""

import argparse
import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path

from runtime import VERSION
from runtime.commands.arguments import SIMULATED
from runtime.commands.options import run_options
from runtime.execution import calibration, carry
from runtime.execution.calibration import CalibrationFile
from runtime.execution.events import Console
from runtime.execution.executor import RunOptions
from runtime.execution.handling import check_arc
from runtime.execution.safe_state import DECLARED
from runtime.execution.safety import check_places, check_table
from runtime.monitoring.console import Lines, Objects
from runtime.shell.errors import InputError
from runtime.table import PPM, Table, TableFile, load, misfits


@dataclass(frozen=True, slots=True)
class Recipe:
    """A table that fits the cell, with what a run of the table needs."""

    path: Path  # file of the table
    loaded: TableFile
    options: RunOptions
    console: Console  # shows the run's events
    header: Mapping[str, object]  # fields for the run's header in the journal
    software: Mapping[str, object]  # entry for the log of installed software


def prepare(arguments: argparse.Namespace, tree: Path) -> Recipe:
    """Loads and validates a table, and checks that it fits the cell which the arguments describe.

    Args:
        arguments: the parsed command line of `grasp-runtime`.
        tree: file of the table.

    Raises:
        ExpectedError: the table is missing or damaged, or does not fit; each class has its `exit_code`.
    """
    loaded, path = load(tree), arguments.calibration
    table, measured = loaded.table, None if path is None else calibration.load(path)
    software = _installed(arguments, tree, loaded, measured)
    if arguments.serve is None:  # a robot that uses --serve may have any gripper
        check_table(table)
    options = run_options(arguments, table, measured and measured.calibration)
    console: Console = Objects(table, arguments.journal) if arguments.json else Lines(table)
    console.note(_headline(tree, table))
    _check_fit(table, options)
    carry.check(options.delivery, table, middle_mm=options.handling.middle_mm)
    return Recipe(tree, loaded, options, console, _header(arguments, tree, options), software)


def _check_fit(table: Table, options: RunOptions) -> None:
    widths = options.handling.widths(table)
    problems = misfits(table, widths)
    if problems:
        raise InputError(problems[0])
    check_arc(options.handling.arc, table.limits, widths)
    check_places(table, options.handling.middle_mm)


def _headline(path: Path, table: Table) -> str:
    headline = f"table {path}: {len(table.nodes)} nodes, {len(table.leaves)} leaves"
    predicted = table.predicted
    if predicted.trials:
        headline += f", predicted success {predicted.success_ppm / PPM:.4f}"
        headline += f", {predicted.mean_squeezes_ppm / PPM:.2f} squeezes a part"
    return headline


def _header(arguments: argparse.Namespace, tree: Path, options: RunOptions) -> dict[str, object]:
    measured = options.handling.calibration
    return {
        "table": str(tree),
        "port": arguments.port,
        "arm": arguments.arm,
        "serve": arguments.serve,
        "plc": arguments.plc,
        "count": options.count,
        "time_scale": "max" if arguments.time_scale == inf else arguments.time_scale,
        "seed": arguments.seed if arguments.port == SIMULATED else None,
        **options.policy.fields(),
        "delivery": None if options.delivery is None else options.delivery.record(),
        "after_crash": arguments.after_crash,
        "force": arguments.force,
        "tips": None if options.handling.arc is None else str(options.handling.arc),
        "calibration": None if arguments.calibration is None else str(arguments.calibration),
        "calibration_um": None if measured is None else list(measured.points_um),
        "middle_um": round(1000 * options.handling.middle_mm),
        "declared_safe_state": DECLARED,
    }


def _installed(
    arguments: argparse.Namespace, tree: Path, loaded: TableFile, measured: CalibrationFile | None
) -> dict[str, object]:
    """Builds a run's entry for the log of installed software: files, digests, versions and the signer.

    Args:
        arguments: the parsed command line.
        tree: file of the table.
        loaded: the table.
        measured: the gripper's calibration; None: none is given.

    Raises:
        InputError: the key of `--require-signed` cannot be used.
        PackError: no pack that is signed with this key holds the table and the calibration.
        UsageError: the extra for signatures is not installed.
    """
    path, data = arguments.calibration, measured and measured.data
    signer: dict[str, object] = {"signer": None, "fingerprint": None, "pack_sha256": None}
    if arguments.require_signed is not None:
        from runtime.signing import keys, pack  # with a library that no other run has to load

        trusted = keys.load_public(arguments.require_signed)
        fields = pack.covering(tree, loaded.data, data, trusted).fields()
        signer = {name: fields[name] for name in signer}
    return {
        "table": str(tree),
        "compiled_by": loaded.table.tool,
        "job_sha256": loaded.table.job_digest.hex(),
        "calibration": None if path is None else str(path),
        "calibration_sha256": None if data is None else hashlib.sha256(data).hexdigest(),
        "squeezetree": VERSION,
        "python": sys.version.split()[0],
        **signer,
    }
