"""Work on several machines: the workers of a Dask cluster (dask.distributed, the extra `cluster`).

All machines need the same version of this package. The scheduler gives the work of a dead worker to the
others.
"""

from __future__ import annotations

import logging
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any, NoReturn, Self, TypeVar

from runtime.shell.errors import UnreachableError, UsageError

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 4  # Items submitted for each thread of the cluster before their first result is taken
CONNECT_S = 10.0
PATIENCE_S = 30.0  # Longest time without workers
POLL_S = 1.0

_ADDRESS = re.compile(r"(tcp|tls|ws|wss|inproc)://\S+")


class Cluster:
    """A connection to a Dask scheduler; a context manager."""

    def __init__(
        self, address: str, connect_s: float = CONNECT_S, patience_s: float = PATIENCE_S
    ) -> None:
        """Stores the address; raises `UsageError` if the text is not an address."""
        if not _ADDRESS.fullmatch(address):
            raise UsageError(f"--scheduler {address}: write the address as tcp://host:8786")
        self.address = address
        self.patience_s = patience_s
        self._connect_s = connect_s
        self._client: Client | None = None

    def __enter__(self) -> Self:
        """Connects to the scheduler, and waits until it has a worker.

        Raises:
            UsageError: dask.distributed is not installed.
            UnreachableError: nothing answers at the address in time, or there are no workers.
        """
        try:
            from distributed import Client
        except ImportError as error:
            needed = f"--scheduler needs the cluster extra ({error.name} is missing)"
            hint = "install squeezetree[cluster]; in a clone: pip install '.[cluster]'"
            raise UsageError(f"{needed}; {hint}") from error
        # An UnreachableError states in one line what the log would say in several.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._client = Client(self.address, timeout=self._connect_s, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            problem = f"no Dask scheduler answers within {self._connect_s:g} s"
            remedy = "check the address, or start one with: dask scheduler"
            raise self._error(f"{problem}; {remedy}") from error
        try:
            self._await_workers()
        except BaseException:  # Ctrl-C, too, must not leave the client connected
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=self._connect_s)

    @property
    def workers(self) -> int:
        """Number of threads of all current workers."""
        try:
            return sum(self._connected().nthreads().values())
        except OSError as error:
            raise self._lost() from error

    def map(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Runs a function on each item on the cluster; yields the results in the order of the items.

        See `planner.work.scheduler.Threads.map` for the arguments.

        Raises:
            UnreachableError: the scheduler is lost, all workers stay away, or several workers died of one
                item.
        """
        client = self._connected()
        most = max(1, AHEAD * self.workers)
        waiting: deque[Future[R]] = deque()
        try:
            for item in items:
                waiting.append(client.submit(function, item, pure=False))
                if len(waiting) >= most:
                    yield self._first(waiting)
            while waiting:
                yield self._first(waiting)
        finally:
            for future in waiting:
                future.release()

    def _first(self, waiting: deque[Any]) -> Any:
        """Waits for the result of the first item, removes the item from `waiting`, and returns the result.

        Checks every `POLL_S` that the cluster still has workers.
        """
        while True:
            try:
                result = waiting[0].result(timeout=POLL_S)
            except Exception as error:
                if waiting[0].status == "error":
                    self._fail(error)
                if isinstance(error, TimeoutError):  # its worker may have died: it runs again
                    self._await_workers()
                elif isinstance(error, CancelledError | OSError):  # also CommClosedError
                    raise self._lost() from error
                else:
                    raise
            else:
                waiting.popleft()
                return result

    def _fail(self, error: Exception) -> NoReturn:
        """Raises the error of an item; raises an `UnreachableError` instead if the cluster is the cause."""
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            problem = "several workers died of the same piece of work"
            remedy = "look into their logs, and give them more memory"
            raise self._error(f"{problem}; {remedy}") from error
        missing = error if isinstance(error, ImportError) else getattr(error, "__cause__", None)
        if isinstance(missing, ImportError):
            problem = f"a machine of the cluster cannot import the planner ({missing})"
            raise self._error(f"{problem}; install squeezetree[cluster] on all of them") from error
        raise error

    def _await_workers(self) -> None:
        """Waits for a worker; raises `UnreachableError` after `patience_s`."""
        deadline = time.monotonic() + self.patience_s
        while self.workers == 0:
            if time.monotonic() > deadline:
                problem = f"the scheduler has had no workers for {self.patience_s:g} s"
                raise self._error(f"{problem}; start some with: dask worker {self.address}")
            time.sleep(0.1)

    def _connected(self) -> Client:
        if self._client is None:
            raise ValueError("a Cluster is connected only within its `with` block")
        return self._client

    def _lost(self) -> UnreachableError:
        return self._error("the scheduler is lost; start it again, and run the command again")

    def _error(self, problem: str) -> UnreachableError:
        return UnreachableError(f"--scheduler {self.address}: {problem}")
