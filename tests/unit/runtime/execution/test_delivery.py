"""The delivery of a part: read from text, file or job, or refused with the name of the invalid key."""

import json
from math import inf, nan, pi

import pytest
from refusals import refused_in_a_line
from sample_tables import changed, several_table

from runtime.execution.delivery import Delivery, by_name, from_file, from_job, from_keys, from_text
from runtime.shell.errors import InputError, UsageError

FULL = """
drop = [50.0, -10, 90]
grasp = "handle"
width_mm = 21.0
area_mm = [-60, -60, 90, 60]
"""
PICKS = {"handle": (1.0, 2.0, -pi / 2)}


def test_from_text_three_numbers_give_drop_off():
    turned = (50.0, -10.0, pytest.approx(pi / 2))
    assert from_text("50,-10,90") == Delivery(drop=turned, width_mm=(0.5, inf))


@pytest.mark.parametrize("header", ["", "[delivery]\n"])
def test_from_file_with_or_without_section_is_read(tmp_path, header):
    path = tmp_path / "d.toml"
    path.write_text(header + FULL)
    result = from_file(path, PICKS)
    assert result.drop == (50.0, -10.0, pytest.approx(pi / 2))
    assert result.grasp == PICKS["handle"]
    assert result.width_mm == (19.5, 22.5)
    assert result.area_um == (-60_000, -60_000, 90_000, 60_000)


def test_from_job_gives_delivery_of_section_or_none():
    assert from_job(None) is None
    assert from_job({"seed": 1}) is None
    assert from_job({"delivery": {"drop": [1, 2, 0]}}) == Delivery(drop=(1.0, 2.0, 0.0))
    assert from_keys({"drop": [0, 0, 0], "width_mm": 10}, "x", {}).width_mm == (8.5, 11.5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "drop is missing"),
        ({"drop": [1, 2, 0], "drop_mm": 3}, "unknown key drop_mm; known are drop"),
        ({"drop": [1, 2]}, "drop takes 3 numbers"),
        ({"drop": 1}, "drop takes 3 numbers"),
        ({"drop": [1, 2, 0], "width_mm": [3]}, "width_mm takes one number"),
        ({"drop": [1, 2, "2"]}, "holds '2', which is no number"),
        ({"drop": [1, 2, True]}, "which is no number"),
        ({"drop": [1, 2, nan]}, "which is no number"),
        ({"drop": [1, 2, inf]}, "beyond 10000"),
        ({"drop": [1, 2, 10**400]}, "beyond 10000"),
        ({"drop": [1, 2, 0], "area_mm": [5, 0, 5, 9]}, "min below its max"),
        ({"drop": [1, 2, 0], "grasp": "rim"}, "grasp 'rim' is none of .* picks: handle"),
        ({"drop": [1, 2, 0], "grasp": [1, 2]}, "is none of .* picks"),
        (3, "no section"),
    ],
)
def test_from_keys_invalid_value_is_refused_by_name(keys, message):
    with pytest.raises(InputError, match=message):
        from_keys(keys, "delivery", PICKS)


@pytest.mark.parametrize(
    "content",
    [None, b"drop = [", b"a = " + b"[" * 100_000, b"delivery = 3", bytes(range(256))],
    ids=["missing", "cut short", "deep", "no section", "binary"],
)
def test_from_file_unreadable_file_is_refused_by_name(tmp_path, content):
    if content is not None:
        (tmp_path / "d.toml").write_bytes(content)
    with refused_in_a_line(InputError, r"d\.toml"):
        from_file(tmp_path / "d.toml", {})


def test_from_job_grasp_is_pick_in_frame_of_datum():
    part = {"datum": [10.0, 0.0, 90.0], "picks": {"handle": [5.0, 0.0, 0.0]}}
    result = from_job({"part": part, "delivery": {"drop": [0, 50, 0], "grasp": "handle"}})
    assert result is not None
    assert result.grasp == pytest.approx((10.0, 5.0, pi / 2))
    with pytest.raises(InputError, match="none of"):
        from_job({"part": part, "delivery": {"drop": [0, 50, 0], "grasp": "rim"}})


def test_by_name_sorts_parts_by_their_names(tmp_path):
    path = tmp_path / "d.toml"
    path.write_text("drop = [50.0, -10, 90]\nwidth_mm = 21.0\n")
    sorting = by_name(["right hand=1,2,0", f"left hand={path}"], several_table())
    assert sorting.of(0) == from_file(path, {})
    assert sorting.of(1) == from_text("1,2,0")
    result = sorting.record()
    assert json.loads(json.dumps(result, allow_nan=False)) == result


@pytest.mark.parametrize(
    ("words", "goal", "message"),
    [
        (["1,2,3"], {}, "write NAME=x,y,angle, the name one of: left hand, right hand"),
        (["hand=1,2,3"], {}, "one of: left hand"),
        (["left hand=1,2,3", "left hand=1,2,3"], {}, "left hand has a place already"),
        (["left hand=1,2,x"], {}, "write x,y,angle"),
        (["left hand=1,2,3"], {"goal.kind": "identity"}, "both which part it is and where"),
        (["left hand=1,2,3"], {"goal.identify": False}, "both which part it is and where"),
    ],
)
def test_by_name_unknown_part_or_unfit_goal_is_refused(words, goal, message):
    with pytest.raises(UsageError, match=message):
        by_name(words, changed(several_table(), goal))
