"""Threads return all results in order and end at the first error; unusable Dask clusters are refused."""

import multiprocessing
import os
import time

import pytest

from planner.work.scheduler import Cluster, Threads, pool_of, scheduler_of
from runtime.shell.errors import UsageError


def squared(value):
    return value * value


def late(value):
    """Takes longer for the first of ten items than for the last."""
    time.sleep(0.002 * (10 - value % 10))
    return value


@pytest.mark.parametrize("workers", [1, 2, 5])
class TestThreads:
    def test_map_results_keep_the_order_of_the_items(self, workers):
        assert list(Threads(workers).map(late, range(40))) == list(range(40))

    def test_map_error_of_the_function_ends_the_work(self, workers):
        begun = []

        def fail(value):
            begun.append(value)
            if value == 3:
                raise RuntimeError("three")
            return value

        with pytest.raises(RuntimeError, match="three"):
            list(Threads(workers).map(fail, range(1000)))
        assert len(begun) < 100

    def test_map_results_not_taken_limit_the_work_ahead(self, workers):
        begun = []
        results = Threads(workers).map(lambda value: begun.append(value) or value, range(1000))
        assert next(results) == 0
        results.close()
        assert len(begun) < 50


def test_map_within_map_does_not_deadlock():
    """The outer map occupies all threads; the inner maps must end without them."""

    def inner(value):
        return sum(Threads(2).map(squared, range(value)))

    def outer(value):
        with pool_of(1) as pool:
            return inner(value), pool.submit(inner, value).result()

    outcome = list(Threads(2).map(outer, range(20)))
    assert outcome == [2 * (sum(map(squared, range(value))),) for value in range(20)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
def test_map_in_a_forked_process_ends():
    assert list(Threads(2).map(squared, range(9))) == [squared(k) for k in range(9)]
    fork = multiprocessing.get_context("fork")
    process = fork.Process(target=lambda: [*Threads(2).map(squared, range(9))])
    process.start()
    process.join(timeout=60)
    assert process.exitcode == 0


@pytest.mark.parametrize(
    "address", ["", "localhost:8786", "tcp:/host:1", "http://host:8786", "tcp://a b"]
)
def test_scheduler_of_invalid_address_is_refused(address):
    with pytest.raises(UsageError, match="tcp://host:8786"), scheduler_of(address):
        pass


def test_cluster_map_outside_its_block_is_refused():
    with pytest.raises(ValueError, match="with"):
        list(Cluster("tcp://127.0.0.1:1").map(squared, [1]))
