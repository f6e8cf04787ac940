"""A small read-only HTTP server beside the control loop: one thread, few clients, short timeouts.

The loop never waits for it. Its cost is bounded: clients at a time, clients a second, bytes of a request,
seconds from a client's first packet to its last.
"""

import contextlib
import selectors
import socket
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from runtime.devices.clock import SystemClock

MOST_CLIENTS = 8
"""One more ends the one that has been here longest."""
PATIENCE_S = 5.0
PAUSE_S = 0.02
"""After each client that is let in, so that no more than fifty a second are."""
MAX_ASK_BYTES = 8192
PIECE = 65536
REASONS = {
    200: "OK",
    400: "Bad Request",
    403: "Forbidden",
    404: "Not Found",
    405: "Method Not Allowed",
}
# No caching, no guessing of media types, no frames; a response ends with its connection.
ALWAYS = """\
Cache-Control: no-store\r
X-Content-Type-Options: nosniff\r
X-Frame-Options: DENY\r
Connection: close\r
"""


def response(code: int, kind: str, body: bytes, more: str = "") -> bytes:
    """A whole HTTP response.

    Args:
        code: one of `REASONS`.
        kind: media type of the body.
        body: what is told.
        more: further header lines, each with its end.
    """
    head = f"HTTP/1.0 {code} {REASONS[code]}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return f"{head}{more}{ALWAYS}\r\n".encode() + body


class _Client:
    """One connection: its request so far, and what of the response is still to be sent."""

    def __init__(self, connection: socket.socket, until: float) -> None:
        connection.setblocking(False)
        self.connection, self.until = connection, until
        self.asked = b""
        self.answer: memoryview | None = None


class Server:
    """Answers requests on a socket in a thread of its own; leaving the context ends it.

    Args:
        listener: listening; closed at the end.
        answer: the whole response to a request's head.
        ask_s: seconds after which an incomplete request is answered, too; None: only complete requests are
            answered, and a client that sends or takes nothing for `PATIENCE_S` is disconnected.
    """

    def __init__(
        self, listener: socket.socket, answer: Callable[[bytes], bytes], ask_s: float | None = None
    ) -> None:
        listener.setblocking(False)
        self._listener, self._answer, self._ask_s, self._clock = listener, answer, ask_s, SystemClock()
        self._clients: list[_Client] = []  # the one that came first is the first
        self._selector = selectors.DefaultSelector()
        self._stop, stopped = socket.socketpair()
        self._selector.register(stopped, selectors.EVENT_READ, stopped)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name="http", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End all connections and stop listening."""
        self._stop.close()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _serve(self) -> None:
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._selector)
            stack.enter_context(self._listener)
            stack.callback(self._drop_all)
            while True:
                for key, _ in self._selector.select(self._patience()):
                    if isinstance(key.data, _Client):
                        self._go_on(key.data)
                    elif key.data is None:
                        self._let_in()
                    else:
                        key.data.close()
                        return
                now = self._clock.now()
                for client in [client for client in self._clients if client.until <= now]:
                    self._end_patience(client)

    def _patience(self) -> float | None:
        """Seconds until the first client times out; None without one."""
        until = min((client.until for client in self._clients), default=None)
        return None if until is None else max(until - self._clock.now(), 0.0)

    def _end_patience(self, client: _Client) -> None:
        if self._ask_s is None or client.answer is not None:
            self._drop(client)
        else:
            self._reply(client)

    def _let_in(self) -> None:
        with contextlib.suppress(OSError):  # gone again, or no descriptor is left: the pause is for that too
            client = _Client(self._listener.accept()[0], self._clock.now() + (self._ask_s or PATIENCE_S))
            if len(self._clients) == MOST_CLIENTS:
                self._drop(self._clients[0])
            self._clients.append(client)
            self._selector.register(client.connection, selectors.EVENT_READ, client)
        self._clock.sleep(PAUSE_S)

    def _go_on(self, client: _Client) -> None:
        """Continue to read or write, whichever this client is ready for."""
        if client not in self._clients:  # dropped for another one a moment ago
            return
        try:
            more = self._read(client) if client.answer is None else self._write(client, client.answer)
        except BlockingIOError:
            more = True
        except OSError:
            more = False
        if not more:
            self._drop(client)

    def _read(self, client: _Client) -> bool:
        piece = client.connection.recv(MAX_ASK_BYTES)
        client.asked += piece
        if not piece or len(client.asked) > MAX_ASK_BYTES:
            if self._ask_s is None:
                return False
            self._reply(client)
        elif b"\r\n\r\n" in client.asked or b"\n\n" in client.asked:
            self._reply(client)
        return True

    def _reply(self, client: _Client) -> None:
        client.answer, client.until = memoryview(self._answer(client.asked)), self._clock.now() + PATIENCE_S
        self._selector.modify(client.connection, selectors.EVENT_WRITE, client)

    def _write(self, client: _Client, answer: memoryview) -> bool:
        client.answer = answer[client.connection.send(answer[:PIECE]) :]
        return len(client.answer) > 0

    def _drop_all(self) -> None:
        for client in tuple(self._clients):
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        self._selector.unregister(client.connection)
        with contextlib.suppress(OSError):
            client.connection.shutdown(socket.SHUT_WR)
        client.connection.close()
