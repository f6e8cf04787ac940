"""Roll-outs killed at any moment: the next run does the rest, and ends with the same bytes."""

import multiprocessing
import signal
import time

import numpy as np
import pytest
import rolling

KILLS = 20


def entries(folder):
    """What lies in a store: bytes and inode of every entry; drafts of killed processes do not count."""
    paths = [path for path in folder.glob("??/*") if path.suffix != ".part"]
    return {path.relative_to(folder): (path.read_bytes(), path.stat().st_ino) for path in paths}


@pytest.fixture(scope="module")
def processes():
    """Starts processes in which everything is imported and compiled, by forking one that waits for it."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["rolling"])
    return context


@pytest.fixture(scope="module")
def undisturbed(processes, tmp_path_factory):
    """The entries of a run that nobody kills, and the seconds it took."""
    folders = [tmp_path_factory.mktemp("undisturbed") for _ in range(2)]
    for folder in folders:  # the first one waits for the process that is forked
        started = time.monotonic()
        process = processes.Process(target=rolling.generate, args=(folder,))
        process.start()
        process.join()
        seconds = time.monotonic() - started
        assert process.exitcode == 0
    contents = [{name: data for name, (data, _) in entries(folder).items()} for folder in folders]
    assert contents[0] == contents[1]
    assert len(contents[0]) > 10
    return contents[0], seconds


def test_the_next_run_after_a_kill_ends_with_the_same_bytes(processes, undisturbed, tmp_path):
    expected, seconds = undisturbed
    direct = rolling.roll_outs(rolling.PART, rolling.RADIUS_MM, rolling.COUNT)
    kept = []
    for kill, moment in enumerate(np.random.default_rng(3).uniform(0.0, seconds, KILLS)):
        folder = tmp_path / str(kill)
        process = processes.Process(target=rolling.generate, args=(folder,))
        process.start()
        process.join(timeout=moment)
        process.kill()
        process.join()
        assert process.exitcode in (0, -signal.SIGKILL)
        before = entries(folder)
        resumed = rolling.generate(folder)
        after = entries(folder)
        assert {name: data for name, (data, _) in after.items()} == expected
        assert before.items() <= after.items()  # what was finished is not made again
        assert all(a.tobytes() == b.tobytes() for a, b in zip(resumed, direct, strict=True))
        kept.append(len(before))
    assert 0 < np.mean(kept) < len(expected)


def test_two_processes_may_fill_one_folder_at_once(processes, undisturbed, tmp_path):
    several = [processes.Process(target=rolling.generate, args=(tmp_path,)) for _ in range(3)]
    for process in several:
        process.start()
    for process in several:
        process.join()
    assert [process.exitcode for process in several] == [0, 0, 0]
    assert {name: data for name, (data, _) in entries(tmp_path).items()} == undisturbed[0]
    assert not list(tmp_path.glob("??/*.part"))
