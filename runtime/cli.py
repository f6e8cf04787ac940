"""The entry points of `grasp-runtime`, `grasp-doctor` and `grasp-calibrate`, which open devices.

This is the only module of the runtime that imports drivers; the other modules import only the drivers'
interfaces (`drivers.ports`). Each entry point loads only the modules that its command needs.
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
    """Runs a command of the cell: stop requests end it, and slow readers of its output do not delay it.

    Args:
        built: the command's parser.
        argv: the arguments; None: those of the process, which ends after the command.
        body: does the command's work with the parsed arguments and the drivers.

    Returns:
        The exit code.
    """

    def stoppable(arguments: argparse.Namespace) -> int:
        with interrupts.stoppable():
            return body(arguments, connect)

    with interrupts.StopRequests(last=argv is None), output.unblocked(SystemClock().now):
        return command.run(built, argv, stoppable, STOPPED)


if __name__ == "__main__":
    sys.exit(main())
