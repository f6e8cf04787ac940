"""Parts through table, `grasp-runtime`, Modbus gripper, arm, rendered camera and `grasp-audit`."""

import json
from dataclasses import replace

import pytest
from audit_loops import agreement, loop, mixed
from cameras import part_tag, true_calibration
from programs import TABLE

from drivers.camera.calibration import file as calibration
from drivers.camera.calibration.file import Reference
from drivers.camera.commands import audit as grasp_audit
from drivers.camera.vision import tag_file
from drivers.sim.camera.rig import standard_rig
from runtime.table import dump, load

PARTS, SEED, TIME_SCALE = 5, 1, 5.0


@pytest.fixture
def folder(tmp_path):
    """Calibration and tag file of the standard camera, and a table some of whose leaves are wrong."""
    rig = standard_rig()
    places = tuple(Reference(number, x, y) for number, (x, y, _) in rig.references)
    known = replace(true_calibration(rig.optics, 0.02), references=places)
    calibration.save(known, tmp_path / "camera.json")
    tag_file.save(part_tag(on_part=rig.on_part), tmp_path / "tag.json", "2026-01-01T00:00:00+00:00")
    dump(mixed(load(TABLE).table), tmp_path / "mixed.msgpack")
    return tmp_path


def test_verdicts_agree_with_the_world_and_are_in_the_journal(folder, capsys):
    result = loop(
        folder / "mixed.msgpack", folder, parts=PARTS, seed=SEED, time_scale=TIME_SCALE, runs=4
    )
    record = agreement(result.parts)
    assert record["at_leaves"] == PARTS, result.faults
    # A fault, on a machine too busy for five times life's speed, means other parts than those of the seed.
    assert result.faults or {"pass", "fail"} <= set(record["verdicts"])
    assert record["agreement"] == 1.0
    assert record["beyond_the_budget"] == 0
    grasp_audit(["report", str(folder / "journal.jsonl"), "--json"])
    reported = json.loads(capsys.readouterr().out)
    assert reported["judged"] == record["verdicts"]["pass"] + record["verdicts"]["fail"]
