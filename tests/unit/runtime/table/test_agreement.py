"""A table is refused if a value differs from that of its embedded job.

So is a table with a leaf whose pose no jaws could hold.
"""

import json
from dataclasses import replace
from math import cos, pi, sin

import pytest
from programs import TABLE as RECTANGLE
from programs import called
from sample_tables import changed, several_table, with_job

from runtime.cli import main
from runtime.table import Area, Push, Table, TableError, dump, dumps, grip, load, loads
from runtime.table.codec import encode
from runtime.table.geometry import gyration_mm

TABLE = load(RECTANGLE).table
WIDE = Area(-900_000, -150_000, 150_000, 150_000)
PUSH = Push(-60_000, 0, 0, 0, 30_000, 30_000)


def shifted(x_um: int, y_um: int) -> Table:
    """The table with all leaves moved by the same distance."""
    leaves = (leaf._replace(x_um=leaf.x_um + x_um, y_um=leaf.y_um + y_um) for leaf in TABLE.leaves)
    return replace(TABLE, leaves=tuple(leaves))


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("limits.squeeze_height_um", -50_000, "squeeze_height_um is -50000, but the embedded job"),
        ("limits.retreat_height_um", 900_000, "limits.retreat_height_um is 900000, but"),
        ("limits.max_force_mn", 500_000, "limits.max_force_mn is 500000, but"),
        ("limits.max_speed_um_s", 150_001, "limits.max_speed_um_s is 150001, but"),
        ("limits.arm_speed_um_s", 2_000_000, "limits.arm_speed_um_s is 2000000, but"),
        ("limits.work_area_um", WIDE, "limits.work_area_um is "),
        ("gripper.model", "robotiq-hand-e", "model is robotiq-hand-e, but the embedded job"),
        ("gripper.noise_um", 0, "gripper.noise_um is 0, but"),
        ("gripper.finger_length_um", 99_000, "gripper.finger_length_um is 99000, but"),
        ("goal.distance_um", 2_999, "goal.distance_um is 2999, but the embedded job says 3000"),
        ("goal.confidence_ppm", 900_000, "goal.confidence_ppm is 900000, but"),
        ("goal.symmetry", 1, "goal.symmetry is 1, but"),
        ("goal.rho_um", 10_000, "goal.rho_um is 10000, but the embedded job says 10571"),
        ("goal.kind", "modes", "goal.kind is modes, but the embedded job says pose"),
        ("nodes.0.squeeze.force_mn", 200_000, "is 200000, but the embedded job says 40000"),
        ("nodes.0.squeeze.speed_um_s", 150_000, "is 150000, but the embedded job says 60000"),
        (
            "nodes.0.squeeze.x_um",
            90_000,
            "at (90.00, 0.00) mm the jaws touch no part within radius",
        ),
        ("nodes.0.pushes", (PUSH,), "actions.pushes is belief, but the embedded job says"),
    ],
)
def test_loads_table_contradicting_its_job_is_refused(path, value, said):
    with pytest.raises(TableError) as refused:
        loads(encode(changed(TABLE, {path: value})))
    assert said in str(refused.value)
    assert str(refused.value).endswith("recompile it")


@pytest.mark.parametrize("direction", range(8))
def test_dumps_leaves_shifted_15_mm_are_refused(direction):
    turn = direction * pi / 4
    with pytest.raises(TableError, match="does not lie between the jaws"):
        dumps(shifted(round(15_000 * cos(turn)), round(15_000 * sin(turn))))


def test_dumps_leaf_turned_by_quarter_is_refused():
    """The turned rectangle is 30 mm wide, but its leaf follows a reading of 21 mm.

    The job's section `doubt` is emptied, since doubts allow larger errors of poses and widths.
    """
    certain = with_job(TABLE, json.dumps({**json.loads(TABLE.job or ""), "doubt": {}}))
    quarter = round(1e6 * pi / 2)
    branches = [branch for node in TABLE.nodes for branch in node.branches]
    number = next(~b.target for b in branches if b.target < 0 and 20_500 < b.expected_um < 21_500)
    turned = {f"leaves.{number}.theta_urad": TABLE.leaves[number].theta_urad + quarter}
    dumps(certain)
    with pytest.raises(TableError, match=f"leaf {number}: the part of the embedded job"):
        dumps(changed(certain, turned))


def test_check_forged_table_is_refused_in_one_line(tmp_path):
    path = tmp_path / "forged.msgpack"
    path.write_bytes(encode(changed(TABLE, {"limits.squeeze_height_um": -50_000})))
    end = called(main, "--tree", path, "--check")
    assert (end.code, end.one_line) == (3, True)
    assert "limits.squeeze_height_um is -50000, but the embedded job says 8000; rec" in end.err


def two_parts(**changes: object) -> dict[str, object]:
    one, two = several_table().hypotheses
    entries = [
        {"part": {"name": each.name, "symmetry": each.symmetry}, "share": each.share_ppm / 1e6}
        for each in (one, two)
    ]
    return {"hypothesis": [entries[0], entries[1] | changes]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"part": {"name": "hammer"}}, "name is right hand, but the embedded job says hammer"),
        ({"share": 0.5}, "share_ppm is 600000, but the embedded job says 500000"),
        ({"part": {"symmetry": 4}}, "symmetry is 1, but the embedded job says 4"),
        ({"part": 3}, "part of the embedded job is no section; recompile it"),
        ({"share": "half"}, "share of the embedded job is no number; recompile it"),
        ({"part": {"outline_mm": [[1, 2, 3]]}}, "outline_mm of the embedded job is no list of"),
    ],
)
def test_dumps_parts_differing_from_job_are_refused(changes, said):
    dumps(with_job(several_table(), json.dumps(two_parts())))
    with pytest.raises(TableError, match=said):
        dumps(with_job(several_table(), json.dumps(two_parts(**changes))))


def test_dumps_sections_missing_from_job_are_not_compared():
    """The table stays valid if its job keeps only one section, and if its job loses one."""
    job = json.loads(TABLE.job or "")
    for name, value in job.items():
        dumps(with_job(TABLE, json.dumps({name: value})))
        dumps(with_job(TABLE, json.dumps({key: kept for key, kept in job.items() if key != name})))


def test_dumps_outline_of_9999_points_is_checked_with_few(monkeypatch):
    """The job has a wavy disc in place of the rectangle, so that the leaves' poses are refused."""
    job = json.loads(TABLE.job or "")
    steps = [2 * pi * k / 9_999 for k in range(9_999)]
    radii = [40 + cos(40 * step) for step in steps]
    points = [(r * cos(step), r * sin(step)) for r, step in zip(radii, steps, strict=True)]
    job["part"]["outline_mm"] = points
    rho_um = round(1e3 * gyration_mm(points))
    forged = with_job(changed(TABLE, {"goal.rho_um": rho_um}), json.dumps(job))
    checked, in_hand = list[int](), grip._in_hand
    monkeypatch.setattr(
        grip, "_in_hand", lambda outline, *at: checked.append(len(outline)) or in_hand(outline, *at)
    )
    with pytest.raises(TableError, match="does not lie between the jaws"):
        dumps(forged)
    assert 3 <= max(checked) <= grip.MOST_POINTS


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (TABLE, "heights, limits, squeezes and poses agree with the job in the table"),
        (replace(TABLE, job=None), "the table carries no job: its heights, limits and poses were"),
    ],
)
def test_check_prints_whether_table_was_compared_with_job(table, said, tmp_path, capsys):
    dump(table, tmp_path / "table.msgpack")
    assert main(["--tree", str(tmp_path / "table.msgpack"), "--check"]) == 0
    out = capsys.readouterr().out
    assert said in out
    assert "plan-evaluate" in out


def test_dumps_number_of_parts_unlike_job_is_refused():
    job = {"part": {"name": "left hand"}}
    with pytest.raises(TableError, match="the number of parts is 2, but the embedded job says 1"):
        dumps(with_job(several_table(), json.dumps(job)))
