"""HTTP exchanges with a deadline, and with a limit on the size of the answer.

The timeout of a socket is no deadline: it applies to each piece of data, so a slow or endless answer could go
on for ever.
"""

import http.client
import io
import socket
import time
import urllib.request
from collections.abc import Callable
from typing import Any, cast


class EndlessError(OSError):
    """The answer is longer than allowed."""


class BoundedSocket:
    """A connected socket with a deadline and a limit of received bytes, for use by `http.client`.

    `allow` sets both for the next exchange; before the first `allow`, every transfer times out.

    Args:
        connection: the socket, with TLS if used; closed with this object.
        now: the clock, wall seconds.
    """

    def __init__(self, connection: socket.socket, now: Callable[[], float]) -> None:
        self._socket = connection
        self._now = now
        self._until, self._left_bytes = now(), 0

    def allow(self, until: float, most_bytes: int) -> None:
        """Sets the deadline of the next exchange, and the size limit of its answer."""
        self._until, self._left_bytes = until, most_bytes

    def sendall(self, data: bytes) -> None:
        """Sends data.

        Raises:
            TimeoutError: the data is not accepted before the deadline.
        """
        self._set_timeout()
        self._socket.sendall(data)

    def makefile(self, mode: str) -> io.BufferedReader:
        """Returns a file from which the answer is read.

        Reading it raises a TimeoutError at the deadline, and an `EndlessError` beyond the size limit.
        """
        assert mode == "rb"
        return io.BufferedReader(_Incoming(self))

    def close(self) -> None:
        """Closes the socket; the connection ends once the files from `makefile` are closed, too."""
        self._socket.close()

    def _set_timeout(self) -> None:
        left_s = self._until - self._now()
        if left_s <= 0.0:
            raise TimeoutError("timed out")
        self._socket.settimeout(left_s)


def opener(until: float, most_bytes: int) -> urllib.request.OpenerDirector:
    """Creates an object whose `open` works like `urllib.request.urlopen`, with a deadline and a size limit.

    Args:
        until: deadline of all exchanges (`time.monotonic`).
        most_bytes: size limit of each answer.
    """

    def bounded(kind: type[http.client.HTTPConnection]) -> type[http.client.HTTPConnection]:
        class Bounded(kind):  # type: ignore[misc, valid-type]
            def connect(self) -> None:
                super().connect()
                within = BoundedSocket(cast(socket.socket, self.sock), time.monotonic)
                within.allow(until, most_bytes)
                self.sock: Any = within

        return Bounded

    class Http(urllib.request.HTTPHandler):
        def http_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
            return self.do_open(bounded(http.client.HTTPConnection), request)

    class Https(urllib.request.HTTPSHandler):
        def https_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
            return self.do_open(bounded(http.client.HTTPSConnection), request)

    return urllib.request.build_opener(Http, Https)


class _Incoming(io.RawIOBase):
    """Unbuffered file of the data that a `BoundedSocket` receives, within the deadline and the size limit."""

    def __init__(self, bounded: BoundedSocket) -> None:
        self._bounded = bounded
        self._raw = cast(io.RawIOBase, bounded._socket.makefile("rb", buffering=0))

    def readable(self) -> bool:
        """Returns True."""
        return True

    def readinto(self, buffer: Any) -> int | None:
        """Reads the next piece of the answer into a buffer; returns its length."""
        self._bounded._set_timeout()
        count = self._raw.readinto(buffer) or 0
        self._bounded._left_bytes -= count
        if self._bounded._left_bytes < 0:
            raise EndlessError("the answer does not end")
        return count

    def close(self) -> None:
        """Releases the socket."""
        self._raw.close()
        super().close()
