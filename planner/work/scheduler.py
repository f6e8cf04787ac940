"""Who does the work: the threads of this machine, or the workers of a Dask cluster.

Work is cut into items that carry all they depend on: results are the same bytes on any number of workers.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from threading import current_thread
from typing import TypeAlias, TypeVar

from planner.work.cluster import Cluster

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 3  # Items handed out for each worker before the first of their results has been taken
WORKER = "squeezetree worker"  # prefix of the names of threads that do alone what they map


def pool_of(workers: int) -> ThreadPoolExecutor:
    """Threads that do alone what they map: if one waited for others of its pool, all might wait."""
    return ThreadPoolExecutor(workers, WORKER)


_kept = cache(pool_of)  # starting threads takes as long as a hundred squeezes
if hasattr(os, "register_at_fork"):  # a forked process has none of its parent's threads
    os.register_at_fork(after_in_child=_kept.cache_clear)


@dataclass(frozen=True, slots=True)
class Threads:
    """Threads of this process: for functions that spend their time in kernels."""

    workers: int = field(
        default_factory=lambda: os.cpu_count() or 1
    )  # all cores unless told otherwise

    def map(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yields the function's results in the order of the items, each as soon as all before it are there.

        Args:
            function: of a module where a cluster may run it; what it raises ends the work.
            items: its arguments; for a cluster they can be pickled.
        """
        if self.workers == 1 or len(items) < 2 or current_thread().name.startswith(WORKER):
            yield from map(function, items)
            return
        pool, waiting = _kept(self.workers), deque[Future[R]]()
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > AHEAD * self.workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
            wait(waiting)


Scheduler: TypeAlias = Threads | Cluster  # Where work runs; `workers` is how many items run at once


@contextmanager
def scheduler_of(address: str | None = None, workers: int | None = None) -> Iterator[Scheduler]:
    """The cluster at an address such as "tcp://host:port", or `workers` threads (all cores if None).

    Raises:
        UsageError: the address is not one, or the cluster extra is not installed.
        UnreachableError: nothing answers there, or it has no workers.
    """
    if address is None:
        yield Threads() if workers is None else Threads(workers)
        return
    with Cluster(address) as cluster:
        yield cluster


__all__ = ["Cluster", "Scheduler", "Threads", "scheduler_of"]
