"""Simulated time from the machine's clock, and servers on local TCP ports."""

import contextlib
import select
import socket
import socketserver
import threading
import time
from collections.abc import Iterator

Lock = contextlib.AbstractContextManager[object]


class SimulatedTime:
    """Simulated seconds: wall time since the start, times the scale.

    Args:
        scale: simulated seconds per wall second.
        stopped: set when the cell stops; ends every pause early.
    """

    def __init__(self, scale: float, stopped: threading.Event) -> None:
        self.stopped = stopped
        self._scale = scale
        self._start = time.monotonic()

    def now(self) -> float:
        """Simulated seconds since the cell came up."""
        return (time.monotonic() - self._start) * self._scale

    def sleep(self, seconds: float) -> None:
        """Sleeps for `seconds` of simulated time, or until the cell stops."""
        self.stopped.wait(seconds / self._scale)

    def wall(self, seconds: float) -> float:
        """Wall seconds of simulated ones."""
        return seconds / self._scale


class Server:
    """A thread that serves until it is closed.

    Args:
        name: of the thread.
        stopped: ends it; set by `close`.
    """

    def __init__(self, name: str, stopped: threading.Event) -> None:
        self._stopped = stopped
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Serves until closed."""
        self._thread.start()

    def close(self) -> None:
        """Stops serving."""
        self._stopped.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        raise NotImplementedError


class ThreadForEach(socketserver.ThreadingTCPServer):
    """A server of the standard library with a thread for each client, which is not waited for."""

    daemon_threads = True
    block_on_close = False

    def handle_error(self, *_: object) -> None:
        """Let a failure reach the thread's end, where the cell hears of it."""
        raise


class LibraryServer(Server):
    """A server of the standard library."""

    def __init__(self, name: str, stopped: threading.Event, server: socketserver.TCPServer) -> None:
        super().__init__(name, stopped)
        self._server = server

    def close(self) -> None:
        """Stops serving."""
        if self._thread.is_alive():
            self._server.shutdown()
        super().close()
        self._server.server_close()

    def _run(self) -> None:
        self._server.serve_forever(0.05)


class TcpServer(Server):
    """Serves one client after another on a TCP port; subclasses implement how."""

    def __init__(
        self, name: str, stopped: threading.Event, address: tuple[str, int] = ("127.0.0.1", 0)
    ) -> None:
        super().__init__(name, stopped)
        self._listener = socket.create_server(address)
        self.port: int = self._listener.getsockname()[1]
        self.url = f"tcp://127.0.0.1:{self.port}"

    def close(self) -> None:
        """Stops serving."""
        super().close()
        self._listener.close()

    def _run(self) -> None:
        while not self._stopped.is_set():
            if self._readable([self._listener]):
                client, _ = self._listener.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with client, contextlib.suppress(OSError):
                    self._serve(client)
                self._left()
        self._listener.close()

    def _serve(self, client: socket.socket) -> None:
        """Serves one client until it leaves, which may raise an OSError, or the server stops."""
        raise NotImplementedError

    def _left(self) -> None:
        """The client was served, and its connection is closed."""

    def _received(self, client: socket.socket, most: int = 4096) -> Iterator[bytes]:
        """Data from a client, until it leaves or the server stops."""
        while not self._stopped.is_set():
            if self._readable([client]):
                if not (data := client.recv(most)):
                    return
                yield data

    def _readable(self, sockets: list[socket.socket], seconds: float = 0.1) -> list[socket.socket]:
        return select.select(sockets, [], [], seconds)[0]
