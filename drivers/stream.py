"""Bytes to and from one device: a serial port, a TCP connection, or a simulated cell's line."""

import contextlib
import errno
import os
import select
import socket
import stat
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn, Protocol
from urllib.parse import urlsplit

import serial

from drivers.errors import PortError
from runtime.shell.host_names import addresses_of

CONNECT_S = 5.0  # wall; for name resolution and connection
SEND_S = 0.5  # wall; a request has some hundred bytes at most, which a line takes in milliseconds
CHUNK = 4096
# Major numbers of pseudo-terminals (Linux, devices.txt), which refuse to have a parity.
PSEUDO_TERMINALS = range(136, 144)


class StalledError(TimeoutError):
    """A connection accepts no bytes: its flow is stopped, or nobody reads at the other end."""

    def __init__(self) -> None:
        super().__init__(
            errno.ETIMEDOUT, f"it has taken no bytes for {SEND_S:g} s; is its flow stopped?"
        )


class Stream(Protocol):
    """An open connection. Sending and receiving raise an OSError once the connection is gone."""

    endpoint: str  # name of the connection in messages

    def send(self, data: bytes) -> None:
        """Sends data in one piece.

        Raises:
            StalledError: not all data were accepted within `SEND_S`; some of them may have been sent.
        """

    def receive(self, seconds: float) -> bytes:
        """Waits at most `seconds` of the cell's clock for data; returns the data, empty if there is none."""

    def close(self) -> None:
        """Closes the connection; idempotent."""


class TcpStream:
    """A TCP connection without send delay; owns the socket. `endpoint` is the port as the user named it."""

    def __init__(self, connection: socket.socket, endpoint: str) -> None:
        self.endpoint = endpoint
        self._socket = connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(SEND_S)

    def send(self, data: bytes) -> None:
        """Sends data in one piece."""
        try:
            self._socket.sendall(data)
        except TimeoutError as error:
            raise StalledError from error

    def receive(self, seconds: float) -> bytes:
        """Returns data that arrives within `seconds`; empty if there is none."""
        if not select.select([self._socket], [], [], max(seconds, 0.0))[0]:
            return b""
        if data := self._socket.recv(CHUNK):
            return data
        raise ConnectionResetError(errno.ECONNRESET, "closed by the device")

    def close(self) -> None:
        """Disconnects."""
        self._socket.close()


class SerialStream:
    """A serial port with 8 data bits and 1 stop bit, locked (`flock`) while it is open.

    On a pseudo-terminal, `parity` is ignored.

    Raises:
        PortError: no such device, no permission, not a serial port, or in use.
    """

    def __init__(self, path: str, baud: int, parity: str = serial.PARITY_NONE) -> None:
        self.endpoint = path
        self._port = _opened(path, baud, parity)
        # An FTDI adapter buffers received data for 16 ms otherwise; other ports do not support the
        # request.
        with contextlib.suppress(ValueError, OSError):
            self._port.set_low_latency_mode(True)

    def send(self, data: bytes) -> None:
        """Sends data in one piece, without pyserial's `write`, which waits forever for a stopped line.

        Raises:
            StalledError: not all data were accepted in time, or data of an earlier request are pending.
        """
        file, until = self._port.fileno(), time.monotonic() + SEND_S
        if self._unsent():  # of an earlier request, which must not be obeyed now
            self._stall()
        while data:
            if not select.select([], [file], [], max(until - time.monotonic(), 0.0))[1]:
                self._stall()
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(file, data) :]

    def receive(self, seconds: float) -> bytes:
        """Returns data that arrives within `seconds`; empty if there is none."""
        file = self._port.fileno()
        if not select.select([file], [], [], max(seconds, 0.0))[0]:
            return b""
        if data := os.read(file, CHUNK):
            return data
        raise OSError(errno.EIO, "the port is gone")

    def set_baud(self, baud: int) -> None:
        """Changes the baud rate."""
        self._port.baudrate = baud

    def close(self) -> None:
        """Closes the port; data pending on a stopped line is not sent, nor waited for."""
        self._discard()
        self._port.close()

    def _unsent(self) -> int:
        """Number of bytes pending on the line; 0 if the driver of the port does not report it."""
        try:
            return int(self._port.out_waiting)
        except OSError:
            return 0

    def _stall(self) -> NoReturn:
        self._discard()
        raise StalledError

    def _discard(self) -> None:
        """Discards unsent data, which the device would obey once the flow continues."""
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self._port.fileno(), termios.TCOFLUSH)


@contextlib.contextmanager
def closed_on_error(opened: Any) -> Iterator[None]:
    """Context that closes `opened` on any error, also on Ctrl-C, which must not leave a port open."""
    try:
        yield
    except BaseException:
        opened.close()
        raise


def tcp_address(url: str, usual: int = 0) -> tuple[str, int]:
    """Returns host and port of a URL `scheme://host:port`; the URL may omit the port if `usual` is given.

    The caller first removes settings after a `?`.

    Raises:
        PortError: the URL has another form.
    """
    try:
        parts = urlsplit(url)
        number = parts.port or usual
    except ValueError:
        parts, number = urlsplit(""), 0
    if not (parts.hostname and number) or parts.path or parts.query:
        scheme = url.partition("://")[0]
        raise PortError(f"port {url} is not understood; write it as {scheme}://host:port")
    return parts.hostname, number


def open_tcp(host: str, port: int, endpoint: str, hint: str) -> TcpStream:
    """Connects to a TCP port; `hint` is for the message of an error, and says what to check.

    Raises:
        PortError: nobody accepts the connection, or the host name is unknown or invalid.
    """
    try:
        connection = connected(host, port, CONNECT_S)
    except (OSError, UnicodeError) as error:  # the latter for an invalid host name
        reason = getattr(error, "strerror", None) or error
        raise PortError(f"nobody accepts a connection at {endpoint} ({reason}); {hint}") from error
    return TcpStream(connection, endpoint)


def connected(host: str, port: int, seconds: float) -> socket.socket:
    """Connects to the first of a host's addresses that accepts a connection, within `seconds` of wall time.

    Raises:
        OSError: the name is unknown, or the connection is not accepted in time.
        UnicodeError: the name is invalid.
    """
    until = time.monotonic() + seconds
    failed: OSError = TimeoutError(errno.ETIMEDOUT, "timed out")
    for family, kind, protocol, _, address in addresses_of(host, port, seconds):
        connection = socket.socket(family, kind, protocol)
        try:
            with closed_on_error(connection):
                connection.settimeout(max(until - time.monotonic(), 1e-3))
                connection.connect(address)
                return connection
        except OSError as error:
            failed = error
    raise failed


def _opened(path: str, baud: int, parity: str) -> serial.Serial:
    try:
        if stat.S_ISCHR(Path(path).stat().st_mode):
            if os.major(Path(path).stat().st_rdev) in PSEUDO_TERMINALS:
                parity = serial.PARITY_NONE
            return serial.Serial(path, baud, parity=parity, timeout=0, exclusive=True)
    except OSError as error:
        raise port_error(path, error) from error
    raise PortError(f"{path} is not a serial port; name a device such as /dev/ttyUSB0")


def port_error(path: str, error: OSError) -> PortError:
    """Converts the error of opening a port to a PortError that says what to do."""
    if error.errno == errno.ENOENT:
        message = (
            f"port {path} does not exist; list ports with `ls /dev/serial/by-id`, or use --port sim"
        )
    elif error.errno in (errno.EACCES, errno.EPERM):
        message = f"no permission to open port {path}; add this user to its group (dialout) and log in again"
    elif error.errno in (errno.EBUSY, errno.EAGAIN):
        message = f"port {path} is in use by another program; stop that program first"
    elif error.errno is not None:
        message = f"port {path} cannot be opened ({os.strerror(error.errno)}); check that it is the right one"
    else:
        message = f"port {path} cannot be opened as a serial port ({error}); check that it is one"
    return PortError(message)
