"""A Dask cluster gives the same bytes as threads do, also when a worker is killed half-way."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from functools import partial

import logged_work
import pytest
from programs import JOB, ROOT, until
from rectangle import quick_job
from refusals import refused_in_a_line

from planner.cli import compile as plan_compile
from planner.work.cluster import AHEAD
from planner.work.scheduler import Cluster, scheduler_of
from runtime.shell.errors import InputError, UnreachableError, UsageError

ENVIRONMENT = os.environ | {
    "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "support")]),
    "DASK_LOGGING__DISTRIBUTED": "critical",
}
ITEMS = 60


@contextmanager
def started(command, *arguments):
    """Runs a `dask` command until the context ends."""
    words = [sys.executable, "-m", "dask", command, "--host", "127.0.0.1", *map(str, arguments)]
    process = subprocess.Popen(words, cwd=ROOT, env=ENVIRONMENT)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def appeared(path):
    """Waits until a process has written a file; returns its text."""
    return until(lambda: path.exists() and path.read_text().strip(), path)


class Machines:
    """Processes of `dask scheduler` and `dask worker` on loopback, which the tests share.

    Tests that kill processes come last.
    """

    def __init__(self, folder, stack):
        self._folder, self._stack = folder, stack
        self.scheduler, self.workers = None, []

    def with_workers(self, n):
        """Starts a scheduler if none runs, and workers until `n` are alive; returns this object."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self._start_scheduler()
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < n:
            self.add_worker()
        return self

    def kill_workers(self):
        for worker in self.workers:
            worker.kill()
            worker.wait()

    def _start_scheduler(self):
        file = self._folder / "scheduler.json"
        file.unlink(missing_ok=True)
        options = ("--port", 0, "--dashboard-address", "127.0.0.1:0", "--scheduler-file", file)
        self.scheduler = self._stack.enter_context(started("scheduler", *options))
        self.address = json.loads(appeared(file))["address"]

    def add_worker(self):
        """Starts a worker with one thread, without a nanny that would start it again."""
        options = ("--nthreads", 1, "--no-nanny", "--no-dashboard")
        options += ("--local-directory", self._folder)
        self.workers.append(self._stack.enter_context(started("worker", self.address, *options)))


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    with ExitStack() as stack:
        yield Machines(tmp_path_factory.mktemp("machines"), stack)


def test_cluster_map_keeps_order_and_raises_original_error(machines, tmp_path):
    with Cluster(machines.with_workers(2).address) as cluster:
        work = partial(logged_work.logged, str(tmp_path / "log"), 0.0)
        assert list(cluster.map(work, range(ITEMS))) == [k * k for k in range(ITEMS)]
        assert list(cluster.map(work, [])) == []
        with pytest.raises(InputError, match="no number") as caught:
            list(cluster.map(logged_work.refused, range(ITEMS)))
        assert caught.value.section == "goal"


def test_plan_compile_on_cluster_writes_identical_tables(machines, tmp_path):
    """The cluster compiles a sweep of two jobs and an invalid one, then one job alone."""
    job = quick_job(tmp_path / "job.toml", "particles = 300\nmax_depth = 3")
    address = ["--scheduler", machines.with_workers(2).address]
    words = [str(job), "--trials", "100", "--no-advice"]
    vary = ["--vary", "uncertainty.radius_mm=4,-1,6"]
    folders = tmp_path / "here", tmp_path / "there"
    for folder, more in zip(folders, ([], address), strict=True):
        assert plan_compile.main([*words, *vary, "-o", str(folder), *more]) == 3
    here, there = ({path.name: path.read_bytes() for path in f.glob("*.msgpack")} for f in folders)
    assert len(here) == 2
    assert here == there
    alone = tmp_path / "alone.msgpack"
    job.write_text(job.read_text().replace("radius_mm = 12.75", "radius_mm = 4"))
    assert plan_compile.main([*words, *address, "-o", str(alone)]) == 0
    assert alone.read_bytes() == here["uncertainty.radius_mm=4.msgpack"]


def test_cluster_map_closed_early_drops_remaining_work(machines, tmp_path):
    log = tmp_path / "log"
    with Cluster(machines.with_workers(2).address) as cluster:
        results = cluster.map(partial(logged_work.logged, str(log), 0.01), range(1000))
        assert next(results) == 0
        results.close()
    time.sleep(0.3)
    assert log.read_text().count("begun") < 60


def test_cluster_map_killed_worker_repeats_only_its_items(machines, tmp_path):
    log = tmp_path / "log"
    with Cluster(machines.with_workers(2).address) as cluster:
        until(lambda: cluster.workers == 2)
        results = []
        for value in cluster.map(partial(logged_work.logged, str(log), 0.03), range(ITEMS)):
            results.append(value)
            if len(results) == ITEMS // 3:
                machines.workers[0].send_signal(signal.SIGKILL)
        assert cluster.workers == 1
    assert results == [k * k for k in range(ITEMS)]
    text = log.read_text()
    by_killed = f"by {machines.workers[0].pid}"
    assert by_killed in text
    # Only items that were handed out at that moment may run again.
    assert ITEMS <= text.count("begun") <= ITEMS + 2 * AHEAD
    assert text.count("begun") - text.count("done") <= 1


def test_cluster_map_new_worker_after_all_died_finishes_work(machines, tmp_path):
    with Cluster(machines.with_workers(1).address) as cluster:
        results = cluster.map(partial(logged_work.logged, str(tmp_path / "log"), 0.05), range(20))
        first = [next(results) for _ in range(5)]
        machines.kill_workers()
        machines.add_worker()
        assert first + list(results) == [k * k for k in range(20)]


def test_cluster_without_workers_is_refused_in_one_line(machines, tmp_path):
    with Cluster(machines.with_workers(1).address) as cluster:
        cluster.patience_s = 1.0
        results = cluster.map(partial(logged_work.logged, str(tmp_path / "log"), 0.05), range(50))
        next(results)
        machines.kill_workers()
        with refused_in_a_line(UnreachableError, r"no workers for 1 s.* dask worker tcp://"):
            list(results)
    with pytest.raises(UnreachableError, match="no workers"):
        Cluster(machines.address, patience_s=0.5).__enter__()


def test_cluster_map_lost_scheduler_is_refused_in_one_line(machines, tmp_path):
    with Cluster(machines.with_workers(1).address, connect_s=5.0) as cluster:
        results = cluster.map(partial(logged_work.logged, str(tmp_path / "log"), 0.05), range(100))
        next(results)
        machines.scheduler.kill()
        with refused_in_a_line(UnreachableError, "scheduler is lost"):
            list(results)


def test_scheduler_of_without_extra_names_it_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    says = refused_in_a_line(UsageError, r"install squeezetree\[cluster\]")
    with says, scheduler_of("tcp://127.0.0.1:9"):
        pass


def test_plan_compile_bad_or_silent_scheduler_is_refused_in_one_line(tmp_path, capsys):
    words = [str(JOB), "-o", str(tmp_path / "t.msgpack")]
    assert plan_compile.main([*words, "--scheduler", "here:8786"]) == 2
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.work.cluster.Cluster.__init__.__defaults__", (0.5, 0.5))
        assert plan_compile.main([*words, "--scheduler", "tcp://127.0.0.1:9"]) == 21
    assert capsys.readouterr().err.count("\n") == 2
    assert not (tmp_path / "t.msgpack").exists()
