"""The commands of the cell, wired to the drivers: `grasp-runtime`, `grasp-doctor` and `grasp-calibrate`.

This is the only module of the runtime that imports drivers; the others import only their interfaces
(`drivers.ports`). Each command loads only the modules it needs.
"""

import argparse
import sys
from collections.abc import Callable, Sequence

from drivers import connect
from drivers.ports import Drivers
from runtime.devices.clock import SystemClock
from runtime.shell import command, interrupts, output
from runtime.shell.exit_codes import ExitCode

Body = Callable[[argparse.Namespace, Drivers], int]
STOPPED = ExitCode.STOPPED, "stopped by the operator while no part was being squeezed"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs `grasp-runtime`; returns its exit code."""
    from runtime.commands import arguments, run

    return guarded(arguments.parser(), argv, run.run)


def doctor(argv: Sequence[str] | None = None) -> int:
    """Runs `grasp-doctor`; returns its exit code."""
    from runtime.commands import doctor as doctor_command

    return guarded(doctor_command.parser(), argv, doctor_command.run)


def calibrate(argv: Sequence[str] | None = None) -> int:
    """Runs `grasp-calibrate`; returns its exit code."""
    from runtime.commands import calibrate as calibrate_command

    words = list(sys.argv[1:] if argv is None else argv)
    first = next((word for word in words if not word.startswith("-")), "")
    if first in calibrate_command.OF_THE_AUDIT:
        from drivers.camera.commands import calibrate as of_the_audit

        return of_the_audit(words)

    return guarded(calibrate_command.parser(), argv, calibrate_command.measured)


def guarded(built: command.Parser, argv: Sequence[str] | None, body: Body) -> int:
    """Runs a command of the cell; returns its exit code.

    A stop request ends the command. The command does not wait for a slow reader of its output.

    Args:
        built: the command's parser.
        argv: the command line; None: that of this process.
        body: performs the command with the parsed arguments and the drivers.
    """

    def stoppable(arguments: argparse.Namespace) -> int:
        with interrupts.stoppable():
            return body(arguments, connect)

    with interrupts.StopRequests(last=argv is None), output.unblocked(SystemClock().now):
        return command.run(built, argv, stoppable, STOPPED)


if __name__ == "__main__":
    sys.exit(main())
