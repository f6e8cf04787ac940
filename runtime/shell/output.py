"""Prints without waiting for a reader, so that a reader cannot delay a cell.

A full pipe, an unread socket or a held terminal (Ctrl-S) would block a print. In the context `unblocked`
nothing blocks: lines that the reader does not take are kept, up to `KEPT_BYTES`, and sent before later lines.
Further lines are dropped. At the command's end the reader has `END_S` to take the kept lines. The journal
records all events of a run, so that a dropped line is only a lost copy.
"""

import contextlib
import fcntl
import os
import select
import socket
import stat
from collections.abc import Callable, Iterator
from io import FileIO
from typing import TextIO

KEPT_BYTES = 1 << 20  # several thousand lines
END_S = 1.0
STDOUT, STDERR = 1, 2
PIECE = 512  # bytes that a ready pipe takes at once (POSIX: PIPE_BUF)

_outlets: dict[int, "Outlet"] = {}


class Outlet:
    """Writes lines to a standard stream without waiting for the reader."""

    def __init__(self, descriptor: int, now: Callable[[], float]) -> None:
        self.lost = 0  # number of dropped lines
        self._now = now
        self._kept = bytearray()
        self._file, self._write = _writer(descriptor)

    def put(self, data: bytes) -> None:
        """Writes a line: sends as much as the reader takes, and keeps the rest for the next call.

        Drops the line `data` if more than `KEPT_BYTES` would be kept.

        Raises:
            OSError: the reader is gone.
        """
        if len(self._kept) + len(data) > KEPT_BYTES:
            self.lost += 1
        else:
            self._kept += data
        self._push()

    def end(self) -> int:
        """Waits up to `END_S` for the reader to take the kept lines; returns the number of all lost lines."""
        until = self._now() + END_S
        while self._kept and (left_s := until - self._now()) > 0.0:
            select.select([], [self._file], [], left_s)
            self._push()
        self.lost += self._kept.count(b"\n")
        self._kept.clear()
        return self.lost

    def close(self) -> None:
        """Closes the outlet; the standard stream stays open."""
        self._file.close()

    def _push(self) -> None:
        try:
            while self._kept:
                del self._kept[: self._write(bytes(self._kept[:PIECE]))]
        except BlockingIOError:
            pass
        except OSError:
            self._kept.clear()
            raise


def _writer(descriptor: int) -> tuple[socket.socket | FileIO, Callable[[bytes], int]]:
    """Opens a second file for a standard stream, to write without waiting.

    The stream itself stays blocking, since other processes may share it.

    Args:
        descriptor: number of the standard stream.

    Returns:
        The file, and a function that writes bytes and returns their number, or raises BlockingIOError.
    """
    if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
        connection = socket.socket(fileno=fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3))
        return connection, lambda data: connection.send(data, socket.MSG_DONTWAIT)
    flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
    try:
        opened = os.open(f"/proc/self/fd/{descriptor}", flags)
    except OSError:  # no /proc, or another user's terminal
        file = FileIO(fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3), "w")
        return file, lambda data: _write_if_ready(file.fileno(), data)
    # With a number of at least 3: if a standard stream is closed, `opened` may have its number.
    file = FileIO(fcntl.fcntl(opened, fcntl.F_DUPFD_CLOEXEC, 3), "w")
    os.close(opened)
    return file, lambda data: os.write(file.fileno(), data)


def _write_if_ready(descriptor: int, data: bytes) -> int:
    if not select.select([], [descriptor], [], 0.0)[1]:
        raise BlockingIOError
    return os.write(descriptor, data)


def outlet_of(file: TextIO) -> Outlet | None:
    """The outlet through which to write to a stream; None if the stream is written as usual."""
    try:
        return _outlets.get(file.fileno())
    except (OSError, ValueError):  # in memory, or closed
        return None


@contextlib.contextmanager
def unblocked(now: Callable[[], float]) -> Iterator[None]:
    """Context in which `command.say` never waits for a reader; output to regular files is written as usual.

    Args:
        now: returns the time, s; at the end of the context it limits the wait for the readers.
    """
    for descriptor in (STDOUT, STDERR):
        with contextlib.suppress(OSError):
            mode = os.fstat(descriptor).st_mode
            if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or stat.S_ISCHR(mode):
                _outlets[descriptor] = Outlet(descriptor, now)
    try:
        yield
    finally:
        for descriptor in list(_outlets):
            outlet = _outlets.pop(descriptor)
            with contextlib.suppress(OSError):
                outlet.end()
            outlet.close()
