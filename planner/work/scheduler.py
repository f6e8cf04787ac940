"""Scheduling of work: on threads of this machine, or on workers of a Dask cluster.

Work is cut into items that do not depend on each other, so that any number of workers gives the same bytes.
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

AHEAD = 3  # Items submitted for each worker before their first result is taken
WORKER = "squeezetree worker"  # prefix of names of threads whose work is not divided further


def pool_of(workers: int) -> ThreadPoolExecutor:
    """Returns a pool of worker threads.

    A call of `Threads.map` in one of these threads runs serially: it would deadlock if it waited for other
    threads.
    """
    return ThreadPoolExecutor(workers, WORKER)


_kept = cache(pool_of)  # starting threads takes as long as a hundred squeezes
if hasattr(os, "register_at_fork"):  # a forked process has none of its parent's threads
    os.register_at_fork(after_in_child=_kept.cache_clear)


@dataclass(frozen=True, slots=True)
class Threads:
    """Runs functions on threads of this process; for functions that spend their time in kernels."""

    workers: int = field(default_factory=lambda: os.cpu_count() or 1)  # default: all cores

    def map(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Runs a function on each item; yields the results in the order of the items, each when it is known.

        Args:
            function: the function. A cluster needs a module-level function. An exception that it raises ends
                the work.
            items: the arguments, one for each call; they must pickle for a cluster.
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


Scheduler: TypeAlias = Threads | Cluster  # `workers` is the number of items that run at once


@contextmanager
def scheduler_of(address: str | None = None, workers: int | None = None) -> Iterator[Scheduler]:
    """Context manager that gives the workers: a cluster if an address is given, else threads.

    Args:
        address: address of the cluster, "tcp://host:port".
        workers: number of threads; None: all cores.

    Raises:
        UsageError: the address is not one, or the cluster extra is not installed.
        UnreachableError: nothing answers at the address, or the cluster has no workers.
    """
    if address is None:
        yield Threads() if workers is None else Threads(workers)
        return
    with Cluster(address) as cluster:
        yield cluster


__all__ = ["Cluster", "Scheduler", "Threads", "scheduler_of"]
