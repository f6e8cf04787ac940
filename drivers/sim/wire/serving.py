"""Serves simulated devices: simulated time, and an event loop in a thread."""

import asyncio
import selectors
import socketserver
import threading
import time
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Self, TypeVar

HOST = "127.0.0.1"
MOST_BYTES = 4096  # longest line, where a port has no limit of its own
Result = TypeVar("Result")
Work = Callable[[], Coroutine[Any, Any, None]]
Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]


class Site:
    """Simulated time, and an event loop in a thread, which makes all calls to devices one after the other.

    Args:
        scale: simulated seconds per wall second.

    Attributes:
        stopped: set when the devices are to be served no longer.
        failures: exceptions of ports that are not the client's fault; they set `stopped`.
    """

    def __init__(self, scale: float = 1.0) -> None:
        self.stopped = threading.Event()
        self.failures: list[Exception] = []
        self._scale = scale
        self._start = time.monotonic()
        # Waits of the default selector are whole milliseconds.
        self._loop = asyncio.SelectorEventLoop(selectors.SelectSelector())
        self._servers: dict[int, asyncio.Server] = {}
        self._tasks = set[asyncio.Task[None]]()
        self._thread = threading.Thread(target=self._run, name="site", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stops serving, and disconnects all clients."""
        self.stopped.set()
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def now(self) -> float:
        """Simulated seconds since the start."""
        return (time.monotonic() - self._start) * self._scale

    async def sleep(self, seconds: float) -> None:
        """Sleeps for `seconds` of simulated time."""
        await asyncio.sleep(seconds / self._scale)

    def at(self, moment: float, happens: Callable[[], object]) -> None:
        """Schedules a call for a moment of simulated time; only to be called on the event loop."""
        self._loop.call_at(self._start + moment / self._scale, happens)

    def call(self, function: Callable[..., Result], *arguments: object) -> Result:
        """Calls a function on the event loop, from another thread; returns the result of the function."""

        async def called() -> Result:
            return function(*arguments)

        return self._wait(called())

    def listen(
        self, serve: Serve, port: int = 0, host: str = HOST, most_bytes: int = MOST_BYTES
    ) -> int:
        """Opens a TCP port, and serves each client until it leaves.

        Args:
            serve: serves one client; the connection is closed afterwards.
            port: number of the port; 0: any.
            host: address of the port.
            most_bytes: longest line of a client.

        Returns:
            Number of the port.

        Raises:
            OSError: the port is taken.
        """

        # No coroutine: asyncio would report each one that is cancelled at the end.
        def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self.begin(partial(serve, reader, writer)).add_done_callback(lambda _: writer.close())

        server = self._wait(asyncio.start_server(connected, host, port, limit=most_bytes - 1))
        number: int = server.sockets[0].getsockname()[1]
        self._servers[number] = server
        return number

    def answer_lines(self, answer: Callable[[bytes], bytes], most_bytes: int) -> int:
        """Opens a TCP port that sends `answer(line)` for each line; returns the number of the port."""

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            while True:
                writer.write(answer(await reader.readuntil()))
                await writer.drain()

        return self.listen(serve, most_bytes=most_bytes)

    def shut(self, port: int) -> None:
        """Closes a port to further clients; only to be called on the event loop."""
        self._servers.pop(port).close()

    def begin(self, work: Work) -> asyncio.Task[None]:
        """Starts a task that serves a device until the site closes; only to be called on the event loop."""
        task = self._loop.create_task(self._guarded(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _wait(self, work: Coroutine[Any, Any, Result]) -> Result:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _guarded(self, work: Work) -> None:
        """Runs `work`; records its exception, unless a client has gone or sends endless lines."""
        try:
            await work()
        except (OSError, EOFError, asyncio.LimitOverrunError):
            pass
        except Exception as error:
            self.failures.append(error)
            self.stopped.set()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop):
            self._loop.run_forever()
            for port in [*self._servers]:
                self.shut(port)


class LibraryServer:
    """Runs a server of the standard library in a thread, until it is closed."""

    def __init__(self, server: socketserver.TCPServer) -> None:
        self._server = server
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self) -> None:
        """Stops serving."""
        self._server.shutdown()
        self._server.server_close()
