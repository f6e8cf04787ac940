"""grasp-runtime with grippers of other makes: their simulators' real bytes, in virtual time and on a pty."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from gripper_tables import table_for

from drivers.sim.grippers import SIMULATORS
from runtime.table import dump, profile_of

ROOT = Path(__file__).parents[2]
REHEARSAL = "runtime.devices.rehearsal:make"
WAIT_S = 240
OTHER_MAKES = [model for model in SIMULATORS if profile_of(model).counts is None]


def parts_of(folder: Path, model: str, *arguments: str) -> list[dict]:
    """The parts of a run whose cell has that gripper."""
    tree = folder / "small.msgpack"
    dump(table_for(model), tree)
    command = [sys.executable, "-m", "runtime.cli", "--tree", str(tree), "--port", "sim"]
    command += ["--world", REHEARSAL, "--journal", str(folder / "journal.jsonl"), "--json"]
    done = subprocess.run(
        [*command, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode in (0, 10), done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("model", OTHER_MAKES)
def test_run_in_virtual_time_locates_20_parts_by_readings_of_the_gripper(tmp_path, model):
    profile = profile_of(model)
    parts = parts_of(tmp_path, model, "--count", "20", "--time-scale", "max", "--seed", "3")
    assert [part["outcome"] in ("leaf", "unresolved") for part in parts] == [True] * 20
    assert all(part["crashes"] == 0 for part in parts)
    readings_um = {round(1000 * width) for part in parts for width in part["readings_mm"]}
    assert all(width == profile.reading_um(profile.step(width)) for width in readings_um)


@pytest.mark.parametrize("model", OTHER_MAKES[:1])
def test_run_against_a_cell_of_its_own_process_locates_parts(tmp_path, model):
    parts = parts_of(tmp_path, model, "--count", "3", "--time-scale", "20", "--seed", "3")
    assert [part["outcome"] in ("leaf", "unresolved") for part in parts] == [True] * 3


@pytest.mark.parametrize("model", SIMULATORS)
def test_grasp_cell_serves_each_gripper_alone_and_connecting_leaves_it_as_it_is(model):
    from drivers import connect

    command = [sys.executable, "-m", "drivers.sim.cli", "--gripper", model, "--json"]
    with subprocess.Popen(
        [*command, "--until-stdin-closes"],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as cell:
        endpoints = json.loads(cell.stdout.readline())
        gripper = connect.gripper(endpoints["port"], profile_of(model))
        assert gripper.profile.model == model
        assert not gripper.state().activated
        gripper.close()
        cell.stdin.close()
        assert cell.wait(WAIT_S) == 0
