"""A small read-only HTTP server beside the control loop, which never waits for it.

Its cost is bounded: clients at a time (a thread each), clients a second, bytes of a request, seconds for a
request and its response.
"""

import contextlib
import socket
import threading
from collections.abc import Callable
from http import HTTPStatus
from typing import Self

from runtime.devices.clock import SystemClock

MOST_CLIENTS = 8  # one more disconnects the oldest
PATIENCE_S = 5.0
PAUSE_S = 0.02  # pause after each accepted client: at most fifty a second
MAX_ASK_BYTES = 8192
# No caching, no guessing of media types, no frames; a response ends with its connection.
ALWAYS = """\
Cache-Control: no-store\r
X-Content-Type-Options: nosniff\r
X-Frame-Options: DENY\r
Connection: close\r
"""


def response(code: int, kind: str, body: bytes, more: str = "") -> bytes:
    """A complete HTTP response with a body; `more` are header lines, each with its end."""
    status = HTTPStatus(code)
    head = f"HTTP/1.0 {status} {status.phrase}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return f"{head}{more}{ALWAYS}\r\n".encode() + body


class Server:
    """Answers requests on a listening socket, in separate threads; leaving the context ends both.

    Only complete requests are answered; a client that is idle for `PATIENCE_S` is disconnected.
    """

    def __init__(self, listener: socket.socket, answer: Callable[[bytes], bytes]) -> None:
        self._listener, self._answer, self._clock = listener, answer, SystemClock()
        self._clients: dict[socket.socket, threading.Thread] = {}  # open ones, the oldest first
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="http", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends all connections and stops listening."""
        self._ended.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # ends its `accept`
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve(self) -> None:
        with self._listener:
            while not self._ended.is_set():
                # The client is gone, or there are no descriptors or threads left: the pause helps
                # there, too.
                with contextlib.suppress(OSError, RuntimeError):
                    self._let_in(self._listener.accept()[0])
                self._ended.wait(PAUSE_S)
        for client, thread in tuple(self._clients.items()):
            self._disconnect(client)
            thread.join()

    def _let_in(self, client: socket.socket) -> None:
        others = tuple(self._clients)
        if len(others) >= MOST_CLIENTS:
            self._disconnect(others[0])
        thread = threading.Thread(target=self._converse, args=(client,), name="http", daemon=True)
        with self._lock:
            thread.start()
            self._clients[client] = thread

    def _disconnect(self, client: socket.socket) -> None:
        """Ends a connection, and so its thread, unless it has ended already."""
        with self._lock, contextlib.suppress(OSError):
            if self._clients.pop(client, None) is not None:
                client.shutdown(socket.SHUT_RDWR)

    def _converse(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            asked = self._read(client)
            if asked is not None:
                client.settimeout(PATIENCE_S)
                client.sendall(self._answer(asked))
                client.shutdown(socket.SHUT_WR)
        with self._lock:
            self._clients.pop(client, None)
            client.close()

    def _read(self, client: socket.socket) -> bytes | None:
        """A request's head; None where it is incomplete."""
        asked, until = b"", self._clock.now() + PATIENCE_S
        while b"\r\n\r\n" not in asked and b"\n\n" not in asked:
            client.settimeout(max(until - self._clock.now(), 1e-3))
            try:
                piece = client.recv(MAX_ASK_BYTES)
            except TimeoutError:
                piece = b""
            asked += piece
            if not piece or len(asked) > MAX_ASK_BYTES:
                return None
        return asked
