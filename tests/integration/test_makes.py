"""grasp-runtime with grippers of other makes: their simulators' real bytes, in virtual time and on a pty."""

import json
import subprocess

import pytest
from programs import CELL, REHEARSAL, VIRTUAL, WAIT_S, called, started
from sample_tables import table_for

from drivers import connect
from drivers.sim import cli as sim
from drivers.sim.grippers import SIMULATORS
from runtime import cli
from runtime.shell.exit_codes import ExitCode
from runtime.table import dump, profile_of

ONE_OF_EACH_MAKE = {kind.scheme: model for model, kind in SIMULATORS.items()}.values()
OTHER_MAKES = [model for model in SIMULATORS if profile_of(model).counts is None]


@pytest.mark.parametrize("model", OTHER_MAKES)
def test_grasp_runtime_other_make_locates_parts_by_its_readings(tmp_path, model):
    profile, tree = profile_of(model), tmp_path / "small.msgpack"
    dump(table_for(model), tree)
    words = ("--tree", tree, "--seed", "3", "--journal", tmp_path / "j", "--count", "6", "--json")
    code, out, _ = called(cli.main, *VIRTUAL, *REHEARSAL, *words)
    assert code in (0, 10)
    parts = [json.loads(line) for line in out.splitlines()]
    assert [part["outcome"] in ("leaf", "unresolved") for part in parts] == [True] * 6
    assert all(part["crashes"] == 0 for part in parts)
    readings_um = {round(1000 * width) for part in parts for width in part["readings_mm"]}
    assert all(width == profile.reading_um(profile.step(width)) for width in readings_um)


WORDS = [["--faults", "seed:1"], ["--block", "20,0,0"], ["--middle", "1"], ["--camera"]]


@pytest.mark.parametrize("words", WORDS, ids=lambda words: words[0])
def test_grasp_cell_gripper_alone_refuses_options_of_whole_cell(words, capsys):
    assert sim.main(["--gripper", "dh-ag95", *words]) == ExitCode.USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert words[0] in line


@pytest.mark.parametrize("model", ONE_OF_EACH_MAKE)
def test_grasp_cell_gripper_alone_is_not_activated_by_connecting(model):
    words = [*CELL, "--gripper", model, "--json", "--until-stdin-closes"]
    with started(words, stdin=subprocess.PIPE, stderr=None) as cell:
        endpoints = json.loads(cell.stdout.readline())
        gripper = connect.gripper(endpoints["port"], profile_of(model))
        assert gripper.profile.model == model
        assert not gripper.state().activated
        gripper.close()
        cell.stdin.close()
        assert cell.wait(WAIT_S) == 0
