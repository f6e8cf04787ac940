"""Base class of the servers for a PLC: runs a server in a thread with an event loop, and ends it in time."""

import asyncio
import signal
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Self

from runtime.plc.exchange import Exchange
from runtime.shell import interrupts

STARTING_S = 60.0  # time until a server answers, on a busy machine
STOPPING_S = 10.0  # wait for the end of a server's thread; a thread that takes longer is abandoned


class PlcServer(ABC):
    """A server for a PLC, as a context: on entering, a thread starts to serve; on leaving, it ends."""

    def __init__(self, exchange: Exchange) -> None:
        self.exchange, self.clock = exchange, exchange.clock
        self.started = threading.Event()  # set once clients are answered
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="plc", daemon=True)

    @abstractmethod
    async def serve(self, stop: asyncio.Event) -> None:
        """Serves clients until `stop` is set; sets `started` as soon as clients are answered."""

    def check(self) -> None:
        """Raises the error with which the server's thread has ended; does nothing if there is none."""
        if self._failure is not None:
            raise self._failure

    def __enter__(self) -> Self:
        self._loop, self._stop = asyncio.new_event_loop(), asyncio.Event()
        self._thread.start()
        try:
            self._await_started()
        except BaseException:  # a stop request, too
            self.__exit__()
            raise
        return self

    def _await_started(self) -> None:
        if not self.started.wait(STARTING_S):
            raise TimeoutError(f"the PLC's server does not answer within {STARTING_S:g} s")
        self.check()

    def __exit__(self, *_: object) -> None:
        with suppress(RuntimeError):  # it has ended by itself
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(STOPPING_S)

    def _run(self) -> None:
        # The main thread handles stop requests: a signal delivered to this thread would not wake it.
        signal.pthread_sigmask(signal.SIG_BLOCK, {*interrupts.SIGNALS, signal.SIGALRM})
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                runner.run(self.serve(self._stop))
        except BaseException as error:  # the main thread raises it in `check`
            self._failure = error
            self.exchange.disconnect()
        finally:
            self.started.set()
