"""A gripper whose fingers meet 1.5 mm off the middle: poses are wrong until the offset is calibrated.

A leaf states a pose in the arm's frame, in which a camera sees the part and the next motion grasps it.
Fingers that meet off the middle displace the part in this frame, although all readings stay the same.
"""

import json
import math

import pytest
from calibrations import linear
from fake_cell import Deaf, FakeJournal
from programs import JOB, ended
from running_cells import CALIBRATE, RunningCell

from drivers.sim.physics.scene import load as load_scene
from drivers.sim.virtual.cell import VirtualCell
from planner.compile import compile_job
from planner.job import model as job_file
from runtime.commands import arguments, options
from runtime.execution import calibration, session
from runtime.execution.delivery import from_text
from runtime.execution.executor import PLAIN, Cell, RunOptions
from runtime.table import dump, load

OFF_MM, PARTS, SEED = 1.5, 8, 4
CERTAIN = {"goal": {"distance_mm": 1.4}, "friction": {"doubt": 0.0}, "doubt": {"chance": 0.0}}
CERTAIN |= {"part": {"tolerance_mm": 0.0}, "search": {"particles": 800}}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A table of the rectangle without doubt about the cell, for a goal below the offset of the fingers."""
    job = job_file.load(JOB, CERTAIN)
    path = tmp_path_factory.mktemp("middle") / "tree.msgpack"
    dump(compile_job(job, workers=1, trials=500).table, path)
    return path


@pytest.fixture(scope="module")
def measured(tree):
    """A calibration file with the middle, as the command writes it, and the record that it prints."""
    widths, result = linear(tree.with_name("gripper.json")), tree.with_name("gripper2.json")
    with RunningCell(tree, "--middle", f"{OFF_MM}", "--block", "30,4,-2", time_scale=100) as cell:
        words = ["middle", "--port", cell.endpoints["gripper"], "--arm", cell.endpoints["arm"]]
        words += ["--tree", tree, "--calibration", widths, "--block", "30", "--at", "5,-1"]
        words += ["-o", result, "--activate", "--tips", "straight", "--json"]
        code, out, err = ended([*CALIBRATE, *words], input="\n")
    assert code == 0, err
    return result, json.loads(out)


def run_parts(tree, handling, delivery=None):
    """Runs parts with the offset of the fingers; returns result, sighting and true pose of each part."""
    ended = []
    setting = load_scene(tree, None, None)._replace(middle_mm=OFF_MM)
    virtual = VirtualCell(setting, SEED)
    console = Deaf()
    console.part = lambda result, seen: ended.append((result, seen, virtual.scene.truth()))
    devices = virtual.gripper(), virtual.arm(), virtual.clock
    cell = Cell(*devices, FakeJournal(), scene=virtual.scene)
    options = RunOptions(handling=handling, delivery=delivery, activate=True, count=PARTS)
    session.run_journalled(load(tree).table, cell, console, options)
    return ended


def handling_of(tree, path):
    words = f"--tree {tree} --port x --arm y --tips straight --calibration {path}"
    given, measured = arguments.parser().parse_args(words.split()), calibration.load(path)
    return options.run_options(given, load(tree).table, measured.calibration).handling


def test_calibrate_middle_measures_offset_and_states_remaining_doubt(measured):
    result, record = measured
    assert abs(record["across_mm"] - OFF_MM) < 3.0 * record["across_error_mm"] < 0.3
    assert record["beside_mm"] == pytest.approx(record["across_mm"], abs=0.3)
    low, high = record["doubt"]["middle_mm"]
    assert low < 0.0 < high < 0.4
    assert record["doubt"]["finger_share"][0] < 0.0 < record["doubt"]["finger_share"][1]
    assert calibration.load(result).calibration.middle.across_mm == record["across_mm"]


def test_run_journalled_finger_offset_gives_wrong_poses_until_calibrated(tree, measured):
    within = (seen.within for _, seen, _ in run_parts(tree, PLAIN.handling))
    before = [each for each in within if each is not None]
    after = [seen.within for _, seen, _ in run_parts(tree, handling_of(tree, measured[0]))]
    assert len(before) > PARTS // 2
    assert sum(before) <= len(before) // 4
    assert after == [True] * PARTS


def test_run_journalled_calibrated_offset_delivers_to_drop_off(tree, measured):
    drop = from_text("20,10,30")
    ended = run_parts(tree, handling_of(tree, measured[0]), drop)
    for result, _, truth in ended:
        assert result.delivery == "done"
        assert math.hypot(truth.x_mm - 20.0, truth.y_mm - 10.0) < 1.5
