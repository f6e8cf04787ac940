"""The server of `grasp-runtime --serve`: answers the lines of one robot at a time.

A second robot gets an error and is disconnected. The first robot is disconnected if it sends only a part of
a line, sends a line before it has the last answer, or does not read its answers. The server works in the
run's thread. Except for the wait for the next line, nothing takes longer than `PATIENCE_S`.
"""

import argparse
import contextlib
import math
import select
import socket

from runtime.commands.arguments import SERVED, given
from runtime.devices.clock import SystemClock
from runtime.errors import JournalError
from runtime.execution.asked import MAX_LINE, AskedParts, refused
from runtime.monitoring.live import server
from runtime.monitoring.monitor import notify
from runtime.shell import interrupts
from runtime.shell.errors import UsageError
from runtime.traversal.results import Outcome

# time for a client to send the rest of a line, to read an answer, or to disconnect
PATIENCE_S = 5.0
MOST_LEAVING = 8  # most connections that wait for their client to disconnect
# A connection to a robot without power is closed after 5 + 3 x 3 s; then another robot may connect.
KEEPALIVE = {socket.TCP_KEEPIDLE: 5, socket.TCP_KEEPINTVL: 3, socket.TCP_KEEPCNT: 3}


def check(arguments: argparse.Namespace) -> server.Address:
    """Checks that the other options are allowed with `--serve`; returns the address to listen at.

    Raises:
        UsageError: the address is invalid, or other machines reach it although `--network` is missing; or an
            option is about devices, which the robot moves itself.
    """
    for name, option in given(arguments).items():
        if name not in SERVED:
            raise UsageError(f"--serve answers a robot that moves itself; leave out {option}")
    return server.served(
        arguments.serve, "--serve", ("tcp",), network=arguments.network, risk="answer for the robot"
    )


class RobotServer:
    """Serves robots that connect to a listening socket, until all parts are done or a stop is requested."""

    def __init__(self, listener: socket.socket, parts: AskedParts, clock: SystemClock) -> None:
        self._listener, self._parts, self._clock = listener, parts, clock
        self._robot: socket.socket | None = None
        self._read = b""  # received part of a line
        self._line_s = 0.0  # deadline for the rest of the line
        # connections that wait for their client to disconnect, each with its deadline
        self._leaving: dict[socket.socket, float] = {}

    def serve(self) -> None:
        """Answers robots until no part follows; at the end, disconnects the robot and closes the socket.

        A part that is not finished ends with the run.

        Raises:
            KeyboardInterrupt: a stop request between two parts.
            JournalError: the journal cannot be written.
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
            with contextlib.suppress(JournalError):  # raised before
                self._hang_up(farewell)
            self._close()

    def _wait(self) -> list[socket.socket]:
        """Waits until sockets can be read, and returns these sockets.

        The wait ends at the next deadline, or after `PATIENCE_S`; then the list is empty.
        """
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
        # A late line is ignored: its reading may be of any squeeze.
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
        with contextlib.suppress(OSError):  # gone again, or out of descriptors
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
        """Receives bytes from the robot, and answers when a line is complete."""
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
        # Letters outside the protocol make no request.
        reply = self._parts.answer(line.decode("latin-1").removesuffix("\r"))
        if not _sent(self._robot, reply):
            self._hang_up(None)

    def _hang_up(self, number: int | None) -> None:
        """Disconnects the robot, if there is one, and gives up its unfinished part.

        Args:
            number: number of the error to send before disconnecting; None: no error.
        """
        if self._robot is None:
            return
        robot, self._robot, self._read = self._robot, None, b""
        self._part_with(robot, number)
        message = "the robot hung up" if number is None else refused(number)
        self._parts.give_up(Outcome.ABORTED, message)

    def _part_with(self, robot: socket.socket, number: int | None) -> None:
        """Begins to disconnect a client: sends an error, and then only waits for the client to disconnect.

        The connection is closed when the client has disconnected, or after `PATIENCE_S`. If it were closed at
        once, the client might not receive the error.

        Args:
            robot: the client's connection.
            number: number of the error to send; None: no error.
        """
        if len(self._leaving) >= MOST_LEAVING:
            self._dismiss(next(iter(self._leaving)), late=True)
        self._leaving[robot] = self._clock.now() + PATIENCE_S
        if number is not None:
            _sent(robot, refused(number))
        with contextlib.suppress(OSError):
            robot.shutdown(socket.SHUT_WR)

    def _dismiss(self, robot: socket.socket, *, late: bool) -> None:
        """Closes a connection if its client has disconnected.

        Args:
            robot: the client's connection.
            late: whether to close it even if the client has not disconnected.
        """
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
