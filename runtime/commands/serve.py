"""The server of `grasp-runtime --serve`: lines of one robot at a time, in the run's own thread.

A second robot is told and sent away; whoever sends half a line, sends ahead of the answer or takes no answer
is disconnected. Nothing here blocks longer than `PATIENCE_S`, but for the next line.
"""

import argparse
import contextlib
import math
import select
import socket

from runtime.commands.arguments import SERVED, parser
from runtime.devices.clock import SystemClock
from runtime.errors import JournalError
from runtime.execution.asked import MAX_LINE, AskedParts, refused
from runtime.monitoring.live import server
from runtime.monitoring.monitor import notify
from runtime.shell import interrupts
from runtime.shell.errors import UsageError
from runtime.traversal.results import Outcome

PATIENCE_S = 5.0  # for the rest of a line, for an answer to be taken, for a goodbye to be read
MOST_LEAVING = 8  # connections whose goodbye may still be on its way
# A robot that lost its power is noticed after 5 + 3 x 3 s without an answer, and its successor let in.
KEEPALIVE = {socket.TCP_KEEPIDLE: 5, socket.TCP_KEEPINTVL: 3, socket.TCP_KEEPCNT: 3}


def check(arguments: argparse.Namespace) -> server.Address:
    """Check what `--serve` goes with; returns where to listen.

    Raises:
        UsageError: it names no address, one of another machine's reach that was not allowed, or comes
            with an option for devices, of which a robot that asks has its own.
    """
    defaults = parser()
    for name, given in vars(arguments).items():
        if name not in SERVED and given != defaults.get_default(name):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"--serve answers a robot that moves itself; leave out {option}")
    return server.served(
        arguments.serve,
        "--serve",
        ("tcp",),
        network=arguments.network,
        risk="answer for the robot",
    )


class RobotServer:
    """Answers on a listening socket, which it closes, until the parts are over or a stop request comes."""

    def __init__(self, listener: socket.socket, parts: AskedParts, clock: SystemClock) -> None:
        self._listener, self._parts, self._clock = listener, parts, clock
        self._robot: socket.socket | None = None
        self._read = b""  # what came of a line
        self._line_s = 0.0  # by when its end has to come
        self._leaving: dict[socket.socket, float] = {}  # by when each has to have hung up

    def serve(self) -> None:
        """Serve; whoever is connected at the end is told, and a part under way ends with the run.

        Raises:
            KeyboardInterrupt: a stop request between two parts. JournalError: the journal cannot be written.
        """
        farewell = 40
        try:
            while not self._parts.over:
                with interrupts.stoppable():
                    ready = self._wait()
                self._look(ready)
        except KeyboardInterrupt:
            if not self._parts.give_up(Outcome.STOPPED, "stopped by the operator"):
                raise
        except JournalError:
            farewell = 41
            raise
        finally:
            with contextlib.suppress(JournalError):  # which was raised before
                self._hang_up(farewell)
            self._close()

    def _wait(self) -> list[socket.socket]:
        """Who has something to say; empty once a deadline has passed, or for the service manager's sake."""
        sockets = [self._listener, *self._leaving]
        ends = list(self._leaving.values())
        if self._robot is not None:
            sockets.append(self._robot)
            ends += [self._line_s] if self._read else []
        if self._parts.deadline is not None:
            ends.append(self._parts.deadline)
        seconds = min(ends, default=math.inf) - self._clock.now()
        notify("WATCHDOG=1")
        return select.select(sockets, [], [], min(max(seconds, 0.0), PATIENCE_S))[0]

    def _look(self, ready: list[socket.socket]) -> None:
        now = self._clock.now()
        for gone in [one for one, until in self._leaving.items() if now >= until or one in ready]:
            self._dismiss(gone, late=now >= self._leaving[gone])
        # A late line is not looked at: what it tells may be of any squeeze.
        if self._parts.deadline is not None and now >= self._parts.deadline:
            self._parts.give_up(Outcome.ABORTED, "the robot did not answer in time")
            self._hang_up(31)
        elif self._robot in ready:
            self._hear()
        elif self._read and now >= self._line_s:
            self._hang_up(14)
        if self._listener in ready:
            self._let_in()

    def _let_in(self) -> None:
        with contextlib.suppress(OSError):  # gone again, or no descriptor is left
            robot = self._listener.accept()[0]
            robot.settimeout(PATIENCE_S)
            if self._robot is not None:
                self._part_with(robot, 30)
                return
            robot.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            robot.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for option, value in KEEPALIVE.items():
                robot.setsockopt(socket.IPPROTO_TCP, option, value)
            self._robot, self._read = robot, b""

    def _hear(self) -> None:
        """Take what came, and answer it if it is a whole line."""
        assert self._robot is not None
        try:
            piece = self._robot.recv(4096)
        except OSError:
            piece = b""
        if not self._read:
            self._line_s = self._clock.now() + PATIENCE_S
        self._read += piece
        line, end, ahead = self._read.partition(b"\n")
        if not piece:
            self._hang_up(None)
        elif ahead:
            self._hang_up(13)
        elif len(line) + len(end) > MAX_LINE:
            self._hang_up(14)
        elif end:
            self._read = b""
            self._answer(line)

    def _answer(self, line: bytes) -> None:
        # Other letters than the protocol's are no request, whatever they are.
        reply = self._parts.answer(line.decode("latin-1").removesuffix("\r"))
        if not _sent(self._robot, reply):
            self._hang_up(None)

    def _hang_up(self, number: int | None) -> None:
        """End the robot's connection, with an error or without, and the part that it was about to squeeze."""
        if self._robot is None:
            return
        robot, self._robot, self._read = self._robot, None, b""
        self._part_with(robot, number)
        message = "the robot hung up" if number is None else refused(number)
        self._parts.give_up(Outcome.ABORTED, message)

    def _part_with(self, robot: socket.socket, number: int | None) -> None:
        """Tell why, and wait for the other side to hang up: closed at once, the line might be lost."""
        if len(self._leaving) >= MOST_LEAVING:
            self._dismiss(next(iter(self._leaving)), late=True)
        self._leaving[robot] = self._clock.now() + PATIENCE_S
        if number is not None:
            _sent(robot, refused(number))
        with contextlib.suppress(OSError):
            robot.shutdown(socket.SHUT_WR)

    def _dismiss(self, robot: socket.socket, *, late: bool) -> None:
        with contextlib.suppress(OSError):
            if not late and robot.recv(4096):
                return
        del self._leaving[robot]
        robot.close()

    def _close(self) -> None:
        until = self._clock.now() + PATIENCE_S / 5
        self._listener.close()
        while self._leaving and (left := until - self._clock.now()) > 0.0:
            for robot in select.select(list(self._leaving), [], [], left)[0]:
                self._dismiss(robot, late=False)
        for robot in list(self._leaving):
            self._dismiss(robot, late=True)


def _sent(robot: socket.socket | None, line: str) -> bool:
    try:
        if robot is not None:
            robot.sendall(line.encode("ascii") + b"\n")
    except OSError:
        return False
    return True
