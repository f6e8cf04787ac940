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
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn, Self, TypeVar

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
        """Stores the address; raises `UsageError` if it is not one."""
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
            hint = "install squeezetree[cluster]; in a clone: pip install '.[cluster]'"
            raise UsageError(
                f"--scheduler needs the cluster extra ({error.name} is missing); {hint}"
            ) from error
        # An UnreachableError states in one line what the log would say in several.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            self._client = Client(self.address, timeout=self._connect_s, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            problem = f"no Dask scheduler answers within {self._connect_s:g} s"
            raise self._error(
                f"{problem}; check the address, or start one with: dask scheduler"
            ) from error
        try:
            self._await_workers()
        except BaseException:  # Ctrl-C, too, must not leave the client connected
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        """Yields results in the order of the items; see `planner.work.scheduler.Threads.map`.

        Raises:
            UnreachableError: the scheduler is lost, all workers stay away, or several died of one item.
        """
        client = self._connected()
        window = max(1, AHEAD * self.workers)
        waiting = deque(enumerate(items))
        running: dict[Future[R], int] = {}
        results: dict[int, R] = {}
        try:
            for k in range(len(items)):
                while k not in results:
                    while waiting and waiting[0][0] < k + window:
                        index, item = waiting.popleft()
                        running[client.submit(function, item, pure=False)] = index
                    self._collect(running, results)
                yield results.pop(k)
        finally:
            for future in running:
                future.release()

    def _collect(self, running: dict[Future[R], int], results: dict[int, R]) -> None:
        """Moves finished items from `running` to `results`; waits at most `POLL_S` if there are none."""
        from distributed import wait

        try:
            with self._connected().as_current():
                done = wait(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            self._await_workers()
            return
        except (CancelledError, OSError) as error:
            raise self._lost() from error
        for future in done:
            if future.status == "error":
                self._fail(future.exception())
            try:
                results[running[future]] = future.result(timeout=POLL_S)
            except TimeoutError:  # its worker died first: it runs again
                continue
            except (CancelledError, OSError) as error:  # also distributed's CommClosedError
                raise self._lost() from error
            del running[future]

    def _fail(self, error: BaseException | None) -> NoReturn:
        """Raises the error of an item: one about the cluster if that is the cause, else the function's."""
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            problem = "several workers died of the same piece of work"
            raise self._error(
                f"{problem}; look into their logs, and give them more memory"
            ) from error
        missing = error if isinstance(error, ImportError) else getattr(error, "__cause__", None)
        if isinstance(missing, ImportError):
            problem = f"a machine of the cluster cannot import the planner ({missing})"
            raise self._error(f"{problem}; install squeezetree[cluster] on all of them") from error
        raise error or self._lost()

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
