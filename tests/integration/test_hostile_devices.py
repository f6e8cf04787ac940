"""Devices, readers and names that do their worst: every command ends, and says which it was."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import termios
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hostile_devices import Bench
from relays import Case
from running_cells import REHEARSAL, ROOT, WAIT_S, Notices
from sample_tables import small_table

from runtime import cli
from runtime.journal.chain import records, verify
from runtime.table import dump

CASES = [
    Case("gripper", "stopped", 8, 1),
    Case("gripper_urcap", "endless", 40),
    Case("arm", "drip", 10),
    Case("arm_ur", "silent", 3, 16),
    Case("scene", "gone", 1),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with contextlib.closing(Bench(tmp_path_factory.mktemp("devices"))) as result:
        yield result


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.device} {case.mode}")
def test_run_whose_device_fails_ends_safely_and_in_the_journal(case: Case, bench: Bench) -> None:
    """`tools/hostile devices` tries hundreds, and looks at the time: this machine may be busy."""
    end = bench.run(case)
    assert (end.reached, end.wrong) == (True, [])
    assert end.code in ("20", "21")


@pytest.fixture
def stopped() -> Iterator[str]:
    """A serial port whose flow is stopped."""
    ends = os.openpty()
    tty.setraw(ends[1])
    termios.tcflow(ends[1], termios.TCOOFF)
    yield os.ttyname(ends[1])
    for end in ends:
        os.close(end)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    dump(small_table(), tmp_path / "small.msgpack")
    return tmp_path / "small.msgpack"


def test_commands_that_look_at_a_stopped_serial_port_end(
    stopped: str, tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    width = ["width", "--port", stopped, "--gripper", "S/N", "-o", str(tmp_path / "g.json")]
    assert cli.main(["--tree", str(tree), "--port", stopped, "--tips", "straight", "--check"]) == 21
    assert cli.calibrate(width) == 21
    assert (
        capsys.readouterr().err.count("it has taken no bytes for 0.5 s; is its flow stopped?") == 2
    )
    assert cli.doctor(["--port", stopped]) == 11
    printed = capsys.readouterr().out
    assert "has taken no bytes" in printed
    assert "cannot be searched" in printed


def test_run_whose_output_nobody_reads_goes_on_and_hears_a_stop_request(
    tree: Path, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.write(writer, bytes(4096))  # it is full
    journal = tmp_path / "journal.jsonl"
    words = [
        "--tree",
        str(tree),
        "--port",
        "sim",
        "--world",
        REHEARSAL,
        "--time-scale",
        "40",
        "--json",
    ]
    words += ["--count", "100000", "--journal", str(journal)]
    with contextlib.closing(Notices(tmp_path)) as notices:
        process = subprocess.Popen(
            [sys.executable, "-m", "runtime.cli", *words],
            cwd=ROOT,
            env=notices.environment,
            stdout=writer,
            stderr=writer,
            text=True,
        )
        for part in (1, 2, 3):
            assert notices.wait(f"part {part}: squeeze", process)
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT_S) == 40
    os.close(reader)
    os.close(writer)
    assert verify(journal).closed
    kinds = [record["kind"] for record in records(journal)]
    assert kinds.count("outcome") == kinds.count("part") >= 3


def test_table_of_an_unknown_gripper_is_refused_before_a_port_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = small_table()
    tree = tmp_path / "other.msgpack"
    dump(replace(table, gripper=replace(table.gripper, model="left-hand-effector")), tree)
    words = [
        "--tree",
        str(tree),
        "--journal",
        str(tmp_path / "j"),
        "--port",
        "/dev/nowhere",
        "--arm",
        "tcp://h:1",
    ]
    assert cli.main(words) == 21
    printed = capsys.readouterr().err
    assert "a left-hand-effector of 227 steps has no register of counts; check the port" in printed
    assert printed.count("\n") == 1
