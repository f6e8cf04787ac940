"""A SCHUNK EGU in the simulated cell: its table, its driver, its bytes, in virtual time."""

import contextlib
import json
import subprocess
import sys

import pytest
from schunk_tables import egu_table

from drivers import connect
from runtime.table import dumps

PARTS = 20


@pytest.mark.timeout(300)
def test_parts_are_localised_by_widths_of_a_hundredth_of_a_millimetre(tmp_path):
    tree = tmp_path / "egu.msgpack"
    tree.write_bytes(dumps(egu_table()))
    settings = ("--time-scale", "max", "--world", "runtime.devices.rehearsal:make", "--json")
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "runtime.cli", "--tree", tree, "--port", "sim", "--activate"),
            *("--count", str(PARTS), "--journal", tmp_path / "journal.jsonl", *settings),
        ],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    parts = [line for line in map(json.loads, ended.stdout.splitlines()) if "outcome" in line]
    assert len(parts) == PARTS, ended.stderr
    assert {part["outcome"] for part in parts} <= {"leaf", "unresolved"}
    assert sum(part["outcome"] == "leaf" for part in parts) > PARTS / 2
    journal = map(json.loads, (tmp_path / "journal.jsonl").read_text().splitlines())
    widths = [line["width_um"] for line in journal if line.get("width_um")]
    assert len(widths) >= PARTS
    assert all(width % 10 == 0 for width in widths)
    assert len(set(widths)) > len(widths) / 2  # finer than the 0.37 mm of a 2F-85


@pytest.mark.timeout(120)
def test_grasp_cell_serves_the_gripper_alone():
    command = [sys.executable, "-m", "drivers.sim.cli", "--gripper", "schunk-egu"]
    with subprocess.Popen(
        [*command, "--json", "--until-stdin-closes"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as cell:
        endpoints = json.loads(cell.stdout.readline())
        assert endpoints["port"] == f"schunk://{endpoints['gripper']}"
        with contextlib.closing(connect.gripper(endpoints["port"], read_only=True)) as gripper:
            assert gripper.state().fault == 0xD9
        cell.stdin.close()
        assert cell.wait(30) == 0
