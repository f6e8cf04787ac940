"""One process a port, and no file left behind."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from runtime import lock as locks
from runtime.errors import PortBusyError
from runtime.lock import PortLock

ROOT = Path(__file__).parents[2]
PORT = "tcp://h:1"
# Takes the lock again and again; while it has it, nobody else may be able to make the file `alone`.
CONTENDER = """
import os, sys, time
from pathlib import Path
from runtime.errors import PortBusyError
from runtime.lock import PortLock

folder, held, refused = Path(sys.argv[1]), 0, 0
print("ready", flush=True)
input()
while held < 100:
    try:
        with PortLock("tcp://h:1", folder):
            os.close(os.open(folder / "alone", os.O_CREAT | os.O_EXCL))
            time.sleep(0.0005)
            os.unlink(folder / "alone")
            held += 1
    except PortBusyError:
        refused += 1
print(refused)
"""


def test_a_port_has_one_owner_whatever_it_is_called(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    with PortLock(str(device), tmp_path):
        with pytest.raises(PortBusyError, match=f"process {os.getpid()}") as refused:
            PortLock(str(link), tmp_path)
        assert refused.value.exit_code == 23
        with PortLock("tcp://h:1", tmp_path), PortLock("tcp://h:2", tmp_path):
            pass
        for one, other in (("tcp://h:1?tool=0,0,1", "tcp://h:1"), ("can:can0", "can:can0?node=12")):
            with PortLock(one, tmp_path), pytest.raises(PortBusyError):
                PortLock(other, tmp_path)
    with PortLock(str(link), tmp_path) as again:
        again.close()


def test_a_lock_that_cannot_be_made_is_a_busy_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PortBusyError, match="cannot be opened"):
        PortLock("tcp://h:1", tmp_path / "no folder")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with PortLock("tcp://h:1") as lock:
        assert lock.path.parent == tmp_path
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "none"))
    with PortLock(f"tcp://h:{os.getpid()}") as lock:
        assert lock.path.parent != tmp_path


def test_no_file_is_left_behind(tmp_path: Path) -> None:
    with PortLock(PORT, tmp_path) as lock:
        assert lock.path.read_text() == f"{os.getpid()}\n"
    assert not list(tmp_path.iterdir())
    lock.close()  # a second time, when the descriptor's number may be another file's


def test_the_file_of_a_killed_process_is_taken_over(tmp_path: Path) -> None:
    with PortLock(PORT, tmp_path) as lock:
        path = lock.path
    path.write_text("4711\n")
    with PortLock(PORT, tmp_path):
        assert path.read_text() == f"{os.getpid()}\n"
    assert not path.exists()


def test_a_file_removed_before_it_is_locked_locks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The race: this process has opened the file; its owner lets go, and perhaps a third takes the port."""
    owner = PortLock(PORT, tmp_path)
    waits = iter([owner.close, lambda: None])

    def let_go_first(file: int, operation: int) -> None:
        next(waits)()
        fcntl.flock(file, operation)

    monkeypatch.setattr(locks, "fcntl", _Locking(let_go_first))
    with PortLock(PORT, tmp_path) as lock:
        monkeypatch.undo()
        assert lock.path.exists()
        with pytest.raises(PortBusyError):
            PortLock(PORT, tmp_path)

    owner = PortLock(PORT, tmp_path)
    third: list[PortLock] = []

    def hand_over_first(file: int, operation: int) -> None:
        if not third:
            owner.close()
            monkeypatch.undo()
            third.append(PortLock(PORT, tmp_path))
        fcntl.flock(file, operation)

    monkeypatch.setattr(locks, "fcntl", _Locking(hand_over_first))
    with pytest.raises(PortBusyError, match=f"process {os.getpid()}"):
        PortLock(PORT, tmp_path)
    third[0].close()
    assert not list(tmp_path.iterdir())


def test_a_file_that_somebody_put_in_its_place_is_not_removed(tmp_path: Path) -> None:
    lock = PortLock(PORT, tmp_path)
    lock.path.unlink()
    with PortLock(PORT, tmp_path) as other:
        lock.close()
        assert other.path.exists()
        with pytest.raises(PortBusyError):
            PortLock(PORT, tmp_path)


def test_contenders_never_hold_it_together(tmp_path: Path) -> None:
    command = [sys.executable, "-c", CONTENDER, str(tmp_path)]
    pipe = subprocess.PIPE
    running = [subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) for _ in range(3)]
    for process in running:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in running:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    refused = [int(process.communicate()[0]) for process in running]
    assert [process.returncode for process in running] == [0, 0, 0]
    assert sum(refused) > 0, "they never met, so nothing was shown"
    assert not list(tmp_path.iterdir())


class _Locking:
    """The module fcntl with another `flock`."""

    LOCK_EX, LOCK_NB = fcntl.LOCK_EX, fcntl.LOCK_NB

    def __init__(self, flock: object) -> None:
        self.flock = flock
