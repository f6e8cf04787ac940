"""A small HTTP server beside the control loop: one thread, few clients, short patience, nothing to change.

The loop never waits for it. What it may cost is bounded on every side: clients at a time, clients a second,
bytes of a question, seconds from a client's first packet to its last.
"""

import contextlib
import selectors
import socket
import threading
from types import TracebackType
from typing import Self

from runtime.devices.clock import SystemClock
from runtime.errors import ArgumentsError
from runtime.monitoring.live.address import Address
from runtime.monitoring.live.answers import Answers

MOST_CLIENTS = 8
"""One more ends the one that has been here longest."""
PATIENCE_S = 5.0
PAUSE_S = 0.02
"""After each client that is let in, so that no more than fifty a second are."""
MAX_ASK_BYTES = 8192
PIECE = 65536


class _Client:
    """One connection: its question so far, and what of the answer is still to be sent."""

    def __init__(self, connection: socket.socket, until: float) -> None:
        connection.setblocking(False)
        self.connection, self.until = connection, until
        self.asked = b""
        self.answer: memoryview | None = None


class PageServer:
    """Answers questions on a TCP port in a thread of its own; leaving the context ends it.

    Args:
        address: where to listen.
        answers: what to answer.

    Attributes:
        address: where it listens, port 0 replaced by the one that was free.

    Raises:
        ArgumentsError: nothing can listen there.
    """

    def __init__(self, address: Address, answers: Answers) -> None:
        self._answers, self._clock = answers, SystemClock()
        self._listener = _listening(address)
        self.address = Address(address.host, int(self._listener.getsockname()[1]))
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
                    self._drop(client)

    def _patience(self) -> float | None:
        """Seconds until the first client is late; None without one."""
        return max(self._clients[0].until - self._clock.now(), 0.0) if self._clients else None

    def _let_in(self) -> None:
        with contextlib.suppress(OSError):  # gone again, or no descriptor is left: the pause is for that too
            client = _Client(self._listener.accept()[0], self._clock.now() + PATIENCE_S)
            if len(self._clients) == MOST_CLIENTS:
                self._drop(self._clients[0])
            self._clients.append(client)
            self._selector.register(client.connection, selectors.EVENT_READ, client)
        self._clock.sleep(PAUSE_S)

    def _go_on(self, client: _Client) -> None:
        """Read on or write on, whatever this client is ready for."""
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
            return False
        if b"\r\n\r\n" in client.asked or b"\n\n" in client.asked:
            client.answer = memoryview(self._answers.to(client.asked))
            self._selector.modify(client.connection, selectors.EVENT_WRITE, client)
        return True

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


def _listening(address: Address) -> socket.socket:
    """A socket that listens at an address."""
    try:
        family, kind, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise ArgumentsError(
            f"--http {address}: {address.host} is no host of this network; {_WORD}"
        ) from error
    listener = socket.socket(family, kind | socket.SOCK_CLOEXEC)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(place)
        listener.listen(MOST_CLIENTS)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise ArgumentsError(f"--http {address}: {_told(error, address)}") from error
    return listener


_WORD = "name an address of this machine, or the port alone"


def _told(error: OSError, address: Address) -> str:
    reason = (error.strerror or str(error)).lower()
    if isinstance(error, PermissionError):
        return f"{reason}: ports below 1024 are for root; take one above, such as 8080"
    if address.port and "in use" in reason:
        return f"{reason}; name another port, or 0 for a free one"
    return f"{reason}; {_WORD}"
