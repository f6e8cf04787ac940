"""The strokes of a squeeze: gentle until contact, never stronger or faster than the node, and level."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from sample_tables import GRIPPER, random_table, small_table

from runtime.errors import TableError
from runtime.execution import strokes
from runtime.execution.tips import TipArc
from runtime.table import PROFILES, Calibration, Node, Profile, Schedule, profile_of

CALIBRATION = Calibration.linear(GRIPPER)
PROFILE = profile_of(GRIPPER.model)
TIMING = replace(Schedule.of(small_table(), None).timing, fastest_mm_s=150.0)
NODES = [node for seed in range(3) for node in random_table(seed, 8).nodes]


def with_force(node: Node, force_mn: int) -> Node:
    return node._replace(squeeze=node.squeeze._replace(force_mn=force_mn))


def plan(node: Node, arc: TipArc | None = None, *, regulated: bool = True) -> list[strokes.Stroke]:
    return strokes.closing(node, PROFILE, CALIBRATION, arc, 85.0, TIMING, regulated=regulated)


@pytest.mark.parametrize("node", NODES[:6])
def test_a_direct_squeeze_is_one_stroke_with_the_nodes_own_settings(node: Node) -> None:
    (only,) = plan(node, regulated=False)
    assert only == (
        255,
        PROFILE.speed_counts(node.squeeze.speed_um_s),
        PROFILE.force_counts(node.squeeze.force_mn),
        0.0,
    )


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("arc", [None, TipArc(), TipArc(level_mm=0.7)])
@pytest.mark.parametrize("contact_um", [None, 41_000, 84_000])
def test_closing_regulated_is_weak_all_the_way_and_fast_only_before_contact(
    node: Node, arc, contact_um
) -> None:
    planned = plan(node._replace(contact_um=contact_um), arc)
    assert {stroke.force_counts for stroke in planned} == {strokes.GENTLE_FORCE}
    requests = [stroke.request_counts for stroke in planned]
    assert (requests, requests[-1]) == (sorted(set(requests)), 255)
    slow = PROFILE.speed_counts(node.squeeze.speed_um_s)
    for stroke in planned:
        before_contact = (
            contact_um is not None and CALIBRATION.width_um(stroke.request_counts) > contact_um
        )
        assert stroke.speed_counts == slow or before_contact
    if contact_um == 41_000:
        assert (
            planned[0].speed_counts
            == PROFILE.speed_counts(round(1000 * TIMING.fastest_mm_s))
            > slow
        )


@pytest.mark.parametrize(
    ("force_mn", "forces"),
    [
        (20_500, [0]),
        (40_000, [23]),
        (60_000, [47]),
        (74_000, [64]),
        (75_000, [64, 65]),
        (235_000, [64, 128, 192, 255]),
    ],
)
def test_the_force_rises_in_steps_to_the_nodes_own(force_mn: int, forces: list[int]) -> None:
    assert strokes.raising(with_force(small_table().nodes[0], force_mn).squeeze, PROFILE) == forces


@pytest.mark.parametrize(
    ("force_mn", "regulated"), [(20_000, False), (20_800, False), (21_000, True), (60_000, True)]
)
def test_regulation_is_off_where_the_force_is_the_least_already(
    force_mn: int, *, regulated: bool
) -> None:
    squeeze = with_force(small_table().nodes[0], force_mn).squeeze
    assert strokes.is_regulated(squeeze, PROFILE, wanted=True) == regulated
    assert not strokes.is_regulated(squeeze, PROFILE, wanted=False)


@pytest.mark.parametrize("arc", [TipArc(), TipArc(level_mm=5.0)])
def test_level_strokes_never_let_the_tips_below_their_height(arc: TipArc) -> None:
    strokes = plan(small_table().nodes[0], arc)
    assert len(strokes) >= 2
    start_mm = 85.0
    for stroke in strokes:
        end_mm = CALIBRATION.width_um(stroke.request_counts) / 1000
        lowest = max(arc.advance_mm(start_mm + (end_mm - start_mm) * k / 20) for k in range(21))
        assert (
            stroke.advance_mm >= lowest - 0.06
        )  # a count is 0.37 mm of width, 0.16 mm of height at most
        start_mm = end_mm


@pytest.mark.parametrize("model", PROFILES)
def test_speeds_and_forces_are_never_more_than_asked_and_the_next_setting_would_be(
    model: str,
) -> None:
    profile = PROFILES[model]
    for ask, (least, most) in (
        (profile.speed_counts, profile.speed_um_s),
        (profile.force_counts, profile.force_mn),
    ):
        for wanted in range(least, most + 1, 997):
            count, step = ask(wanted), (most - least) / 255
            assert least + count * step <= wanted < least + (count + 1) * step
        assert [ask(value) for value in (0, least, most, 10**9)] == [0, 0, 255, 255]


@pytest.mark.parametrize(
    ("message", "model"),
    [
        ("Robotiq 2F-85", "robotiq-2f-85"),
        ("C-85", "robotiq-2f-85"),
        (" ROBOTIQ_2f  140 ", "robotiq-2f-140"),
        ("Robotiq Hand-E", "hand-e"),
    ],
)
def test_a_model_is_found_by_its_name(message: str, model: str) -> None:
    assert profile_of(message) is PROFILES[model]


@pytest.mark.parametrize(
    "model",
    ["left-hand-effector", "My 2F-140", "2F-850", "parallel jaws", "robotiq", "", "hand-e\n2f-85"],
)
def test_profile_of_a_model_that_is_not_known_is_refused(model: str) -> None:
    with pytest.raises(TableError, match=r"not known; there are robotiq-2f-85") as raised:
        profile_of(model)
    assert "\n" not in str(raised.value)


def point_at(profile: object, folder: Path) -> None:
    """A package that brings a profile, as pip leaves it."""
    info = folder / "other_make-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other_make\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[squeezetree.profiles]\nother-60 = other_profile:PROFILE\n"
    )
    (folder / "other_profile.py").write_text(
        f"from runtime.table import Profile\nPROFILE = {profile!r}\n"
    )


def test_profile_comes_from_the_driver_that_brings_the_gripper(tmp_path: Path, monkeypatch) -> None:
    brought = Profile("other-60", 60_000, 0, 255, (5_000, 50_000), (1_000, 60_000), ())
    point_at(brought, tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "other_profile", raising=False)
    assert profile_of("Other 60") == brought


@pytest.mark.parametrize(
    "profile", [None, Profile("other-60", 60_000, 0, 255, (50_000, 5_000), (1_000, 60_000), ())]
)
def test_profile_that_is_none_is_refused(profile: object, tmp_path: Path, monkeypatch) -> None:
    point_at(profile, tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "other_profile", raising=False)
    with pytest.raises(TableError, match="not understood"):
        profile_of("other-60")


def test_an_opening_is_at_least_as_wide_as_asked() -> None:
    for opening_um in range(1, 85_001, 333):
        request = strokes.opening_counts(opening_um, CALIBRATION)
        assert CALIBRATION.width_um(request) >= opening_um
        assert request == 0 or CALIBRATION.width_um(request + 1) < opening_um
    assert strokes.opening_counts(99_000, CALIBRATION) == 0
