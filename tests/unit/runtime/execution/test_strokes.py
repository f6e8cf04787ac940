"""The strokes of a squeeze, gentle until contact, and the gripper profiles that they use."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from counting import CALIBRATION, SETTINGS
from refusals import refused_in_a_line
from sample_tables import GRIPPER, random_table, small_table

from runtime.errors import TableError
from runtime.execution import strokes
from runtime.execution.handling import Handling
from runtime.execution.tips import TipArc
from runtime.table import PROFILES, GripperProfile, Node, Schedule, profile_of

PROFILE = profile_of(GRIPPER.model)
TIMING = replace(Schedule.of(small_table(), None).timing, fastest_mm_s=150.0)
NODES = [node for seed in range(3) for node in random_table(seed, 8).nodes]


def with_force(node: Node, force_mn: int) -> Node:
    return node._replace(squeeze=node.squeeze._replace(force_mn=force_mn))


def plan(node: Node, arc: TipArc | None = None, *, regulated: bool = True) -> list[strokes.Stroke]:
    handling = Handling(arc=arc, regulated=regulated)
    return strokes.closing(node, handling, CALIBRATION, 85.0, TIMING)


@pytest.mark.parametrize("node", NODES[::3])
@pytest.mark.parametrize("arc", [None, TipArc(), TipArc(level_mm=0.7)])
@pytest.mark.parametrize("contact_um", [None, 41_000, 84_000])
def test_closing_regulated_is_weak_and_fast_only_before_contact(node, arc, contact_um):
    planned = plan(node._replace(contact_um=contact_um), arc)
    assert {stroke.force_n for stroke in planned} == {PROFILE.force_n[0]}
    requests = [stroke.request_um for stroke in planned]
    assert (requests, requests[-1]) == (sorted(set(requests), reverse=True), -1)
    slow = node.squeeze.speed_um_s / 1000
    for stroke in planned:
        width_um = CALIBRATION.width_um(stroke.request_um)
        assert stroke.speed_mm_s == slow or (contact_um is not None and width_um > contact_um)
    if contact_um == 41_000:
        assert planned[0].speed_mm_s == TIMING.fastest_mm_s > slow


@pytest.mark.parametrize(
    ("force_mn", "forces"),
    [(20_500, [0]), (73_900, [63]), (75_000, [64, 65]), (235_000, [64, 128, 192, 255])],
)
def test_raising_force_rises_in_steps_to_force_of_node(force_mn, forces):
    squeeze = with_force(small_table().nodes[0], force_mn).squeeze
    raised = strokes.raising(squeeze, Handling(regulated=True), PROFILE)
    assert strokes.raising(squeeze, Handling(), PROFILE) == []
    assert raised == sorted(raised)
    assert [SETTINGS.force(force) for force in raised] == forces


@pytest.mark.parametrize(
    ("message", "model"),
    [
        ("Robotiq 2F-85", "robotiq-2f-85"),
        ("C-85", "robotiq-2f-85"),
        (" ROBOTIQ_2f  140 ", "robotiq-2f-140"),
        ("Robotiq Hand-E", "hand-e"),
    ],
)
def test_profile_of_name_of_model_is_its_profile(message, model):
    assert profile_of(message) is PROFILES[model]


@pytest.mark.parametrize(
    "model",
    ["left-hand-effector", "My 2F-140", "2F-850", "parallel jaws", "robotiq", "", "hand-e\n2f-85"],
)
def test_profile_of_unknown_model_is_refused(model):
    with refused_in_a_line(TableError, "not known; there are robotiq-2f-85"):
        profile_of(model)


def bring(profile: object, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs a package with a gripper profile in a folder, as pip would."""
    info = folder / "other_make-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other_make\nVersion: 1.0\n")
    entry = "[squeezetree.profiles]\nother-60 = other_profile:PROFILE\n"
    (info / "entry_points.txt").write_text(entry)
    source = f"from runtime.table import GripperProfile\nPROFILE = {profile!r}\n"
    (folder / "other_profile.py").write_text(source)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "other_profile", raising=False)


def test_profile_of_plugin_gripper_comes_from_its_package(tmp_path, monkeypatch):
    brought = GripperProfile("other-60", 60_000, 10.0, 20, (5.0, 50.0), (1.0, 60.0))
    bring(brought, tmp_path, monkeypatch)
    assert profile_of("Other 60") == brought


@pytest.mark.parametrize(
    "profile", [None, GripperProfile("other-60", 60_000, 10.0, 20, (50.0, 5.0), (1.0, 60.0))]
)
def test_profile_of_plugin_that_is_invalid_is_refused(profile, tmp_path, monkeypatch):
    bring(profile, tmp_path, monkeypatch)
    with pytest.raises(TableError, match="not understood"):
        profile_of("other-60")
