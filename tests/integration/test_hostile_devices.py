"""Failing devices, stopped ports, unread output and unknown grippers: each command ends with a reason."""

import contextlib
import fcntl
import os
import signal
import termios
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hostile_devices import Bench
from programs import REHEARSAL, RUNTIME, WAIT_S, called, started
from relays import Case
from running_cells import Notices
from sample_tables import small_table

from runtime import cli
from runtime.journal.chain import records, verify
from runtime.table import dump

CASES = [Case("gripper", "stopped", 8, 1), Case("gripper_urcap", "endless", 40)]
CASES += [Case("arm", "drip", 10), Case("arm_ur", "silent", 3, 16), Case("scene", "gone", 1)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with contextlib.closing(Bench(tmp_path_factory.mktemp("devices"))) as result:
        yield result


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.device} {case.mode}")
def test_grasp_runtime_failing_device_ends_safely_and_journalled(case: Case, bench: Bench) -> None:
    """Times are not checked here, since a busy machine may exceed them.

    `tools/hostile devices` checks them, and tries hundreds of cases.
    """
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


def test_check_calibrate_and_doctor_stopped_port_end_with_reason(stopped, tree, tmp_path) -> None:
    check = ("--tree", tree, "--tips", "straight", "--check")
    width = ("width", "--gripper", "S/N", "-o", tmp_path / "g.json")
    for main, words in ((cli.main, check), (cli.calibrate, width)):
        ended = called(main, *words, "--port", stopped)
        assert ended.code == 21
        assert "it has taken no bytes for 0.5 s; is its flow stopped?" in ended.err
    ended = called(cli.doctor, "--port", stopped)
    assert ended.code == 11
    assert "has taken no bytes" in ended.out
    assert "cannot be searched" in ended.out


def test_grasp_runtime_unread_output_blocks_neither_run_nor_stop(tree, tmp_path) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.write(writer, bytes(4096))  # the pipe is full
    journal = tmp_path / "journal.jsonl"
    words = [*RUNTIME, "--tree", tree, "--port", "sim", *REHEARSAL, "--time-scale", "40", "--json"]
    words += ["--count", "100000", "--journal", journal]
    with contextlib.closing(Notices(tmp_path)) as notices:
        process = started(words, env=notices.environment, stdout=writer, stderr=writer)
        for part in (1, 2, 3):
            assert notices.wait(f"part {part}: squeeze", process)
        process.send_signal(signal.SIGTERM)
        assert process.wait(WAIT_S) == 40
    os.close(reader)
    os.close(writer)
    assert verify(journal).closed
    kinds = [record["kind"] for record in records(journal)]
    assert kinds.count("outcome") == kinds.count("part") >= 3


def test_grasp_runtime_unknown_gripper_is_refused_before_port_opens(tree: Path) -> None:
    table = small_table()
    dump(replace(table, gripper=replace(table.gripper, model="left-hand-effector")), tree)
    words = ("--tree", tree, "--journal", tree.with_name("j"), "--port", "/dev/nowhere")
    ended = called(cli.main, *words, "--arm", "tcp://h:1")
    assert (ended.code, ended.one_line) == (21, True)
    said = "a left-hand-effector of 227 steps has no register of counts; check the port"
    assert said in ended.err
