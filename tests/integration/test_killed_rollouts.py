"""Roll-outs killed at any moment: the next run does the rest, and ends with the same bytes."""

import multiprocessing
import os
import signal
import sys
import time

import numpy as np
import pytest
import rolling

KILLS = 7
BLOCK_S = 0.012
"""About what a block takes."""


def entries(folder):
    """What lies in a store: bytes and inode of every entry; drafts of killed processes do not count."""
    paths = [path for path in folder.glob("??/*") if path.suffix != ".part"]
    return {path.relative_to(folder): (path.read_bytes(), path.stat().st_ino) for path in paths}


@pytest.fixture(scope="module")
def processes():
    """Starts processes in which everything is imported and compiled, by forking one that waits for it."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["rolling"])
    with pytest.MonkeyPatch.context() as patch:  # a fork server has no other way to find modules
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        multiprocessing.forkserver.ensure_running()
    return context


@pytest.fixture(scope="module")
def undisturbed(processes, tmp_path_factory):
    """The entries of a run that nobody kills, twice the same."""
    folders = [tmp_path_factory.mktemp("undisturbed") for _ in range(2)]
    for folder in folders:
        process = processes.Process(target=rolling.generate, args=(folder,))
        process.start()
        process.join()
        assert process.exitcode == 0
    contents = [{name: data for name, (data, _) in entries(folder).items()} for folder in folders]
    assert contents[0] == contents[1]
    assert len(contents[0]) > 10
    return contents[0]


def killed(process, folder, count, seconds):
    """Kills a process some time after its store holds so many entries; how many it holds then."""
    process.start()
    while len(entries(folder)) < count and process.is_alive():
        time.sleep(0.001)
    process.join(timeout=seconds)
    process.kill()
    process.join()
    assert process.exitcode in (0, -signal.SIGKILL)
    return entries(folder)


def test_the_next_run_after_a_kill_ends_with_the_same_bytes(processes, undisturbed, tmp_path):
    direct = rolling.roll_outs(rolling.PART, rolling.RADIUS_MM, rolling.COUNT)
    generator = np.random.default_rng(3)
    kept = []
    for kill in range(KILLS):
        folder = tmp_path / str(kill)
        process = processes.Process(target=rolling.generate, args=(folder,))
        before = killed(
            process, folder, 2 * kill % len(undisturbed), generator.uniform(0.0, BLOCK_S)
        )
        resumed = rolling.generate(folder)
        after = entries(folder)
        assert {name: data for name, (data, _) in after.items()} == undisturbed
        assert before.items() <= after.items()  # what was finished is not made again
        assert all(a.tobytes() == b.tobytes() for a, b in zip(resumed, direct, strict=True))
        kept.append(len(before))
    assert 0 < np.mean(kept) < len(undisturbed)


def test_two_processes_may_fill_one_folder_at_once(processes, undisturbed, tmp_path):
    several = [processes.Process(target=rolling.generate, args=(tmp_path,)) for _ in range(3)]
    for process in several:
        process.start()
    for process in several:
        process.join()
    assert [process.exitcode for process in several] == [0, 0, 0]
    assert {name: data for name, (data, _) in entries(tmp_path).items()} == undisturbed
    assert not list(tmp_path.glob("??/*.part"))
