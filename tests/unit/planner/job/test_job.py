"""Jobs: from a file, to canonical text and back, and files that cannot be read."""

import hashlib
import json
import re
import tomllib

import numpy as np
import pytest
from rectangle import JOB_PATH, TEXT, edited

from planner.job import fields, schema
from planner.job import model as job
from runtime.execution import delivery
from runtime.shell.errors import InputError
from runtime.table import PROFILES


@pytest.fixture
def rectangle() -> job.Job:
    return job.load(JOB_PATH)


def test_canonical_text_round_trips_exactly(rectangle):
    text = rectangle.canonical()
    again = job.from_canonical(text)
    assert again == rectangle
    assert again.canonical() == text
    assert hash(again) == hash(rectangle)
    assert text == json.dumps(json.loads(text), sort_keys=True, separators=(",", ":"))
    assert rectangle.digest() == hashlib.sha256(text.encode()).digest()


def test_digest_does_not_depend_on_how_the_job_is_written(rectangle):
    without_defaults = re.sub(
        r"(?m)^(symmetry|wishart_dof|model|opening_mm|noise_mm|speed\w+|force\w+) .*\n", "", TEXT
    )
    assert len(without_defaults) < len(TEXT)
    elsewhere = edited(
        "[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[100.0, 7], [100.0, 28], [130, 28], [130, 7]]"
    )
    for text in (without_defaults, elsewhere, TEXT.replace("\n", "\r\n")):
        assert job.parse(text).digest() == rectangle.digest()
    assert job.parse(edited("seed = 1", "seed = 2")).digest() != rectangle.digest()


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES.keys())
def test_parse_gripper_model_alone_gets_speed_and_force_in_its_range(profile):
    text = re.sub(r"(?m)^(model|opening_mm|noise_mm|speed\w+|force\w+) .*\n", "", TEXT)
    text = text.replace("[gripper]", f'[gripper]\nmodel = "{profile.model}"')
    gripper = job.parse(text).gripper
    (slowest, fastest), (least_n, most_n) = profile.speed_mm_s, profile.force_n
    assert slowest <= gripper.speed_mm_s <= fastest
    assert least_n <= gripper.force_n <= most_n
    if profile.grip_mm_s is not None:  # the speed of a grip, proportional to the force
        assert gripper.speed_mm_s <= profile.grip_mm_s * gripper.force_n / most_n


def test_parse_schunk_egk_force_limits_the_closing_speed():
    stated = TEXT.replace('"robotiq-2f-85"', '"schunk-egk"').replace("opening_mm = 85.0", "")
    slow = job.parse(stated.replace("speed_mm_s = 60.0", "").replace("40.0", "25.0", 1))
    assert (slow.gripper.force_n, slow.gripper.speed_mm_s) == (25.0, 10.0)
    with pytest.raises(InputError, match="grips with 40 N at 16 at most; lower it"):
        job.parse(stated)


def test_from_canonical_very_coarse_gripper_restores_the_job():
    coarse = job.parse(edited("noise_mm = 0.15", "noise_mm = 10\nresolution_mm = 9"))
    assert job.from_canonical(coarse.canonical()) == coarse


def test_parse_broken_toml_gives_line_and_column():
    with pytest.raises(InputError, match=r"my.toml: .* line 2, column 8"):
        job.parse("seed = 1\nname = = 2\n", "my.toml")
    with pytest.raises(InputError, match="line 3, column"):
        job.parse("[part]\n\noutline_mm = [[0, 0]")
    for text in ("[part]\n[part]", "x = " + "[" * 100_000, "seed = " + "9" * 10_000, "\x00"):
        with pytest.raises(InputError, match="not valid TOML"):
            job.parse(text)


def test_load_unreadable_file_is_refused_and_named(tmp_path):
    latin = tmp_path / "latin.toml"
    latin.write_bytes("name = 'Würfel'".encode("latin-1"))
    for path, reason in (
        (tmp_path / "absent.toml", "No such file"),
        (tmp_path, "Is a directory"),
        (latin, r"not UTF-8 text \(byte 10\)"),
        ("a\0b", "null"),
    ):
        with pytest.raises(InputError, match=reason) as caught:
            job.load(path)
        assert caught.value.where == str(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000])
def test_from_canonical_not_a_json_object_is_refused(text):
    with pytest.raises(InputError, match="compile the job again"):
        job.from_canonical(text)


MOST_KEYS = 66  # without the keys that go with one kind of pressure
WIDTH_AND_AREA = {"width_mm": 21, "area_mm": [-60, -60, 90, 60]}
DELIVERY = "[delivery]\ndrop = [50, 0, 180]\n"


def test_delivery_from_job_reads_what_the_job_states():
    result = job.parse(TEXT + DELIVERY + "width_mm = 21\narea_mm = [-60, -60, 90, 60]\n")
    assert job.from_canonical(result.canonical()) == result
    keys = {"drop": [50, 0, 180]} | WIDTH_AND_AREA
    assert delivery.from_job(json.loads(result.canonical())) == delivery.from_keys(keys, "here", {})
    shorter = json.loads(job.parse(TEXT + DELIVERY).canonical())
    assert delivery.from_job(shorter) == delivery.from_text("50,0,180")


def test_delivery_fields_equal_the_keys_of_the_runtime():
    assert {*schema.FIELDS["delivery"]} == {*delivery.KEYS}
    for key, count in delivery.NUMBERS.items():
        field = schema.FIELDS["delivery"][key]
        assert (field.least if isinstance(field, fields.Numbers) else 0) == count


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[delivery]\nwidth_mm = 3", "missing key drop"),
        ("[delivery]\ndrop = [1, 2]", "must have 3 entries"),
        ("[delivery]\ndrop = [50, 0, 0]\ndrop_mm = 3", "unknown key"),
        (
            "[delivery]\ndrop = [500, 0, 0]",
            "brings the hand to .500, 0., outside work_area_mm of .cell.",
        ),
        ("[delivery]\ndrop = [50, 0, 0]\narea_mm = [9, 9, 0, 0]", "min below max"),
        ("[delivery]\ndrop = [50, 0, 0]\nwidth_mm = 90", "not below opening_mm"),
        ("delivery = 3", "must be a section"),
    ],
)
def test_parse_invalid_delivery_is_refused(text, message):
    with pytest.raises(InputError, match=message) as raised:
        job.parse(f"{text}\n{TEXT}" if text.startswith("delivery") else f"{TEXT}\n{text}\n")
    assert "\n" not in str(raised.value)


def test_parse_datum_and_picks_move_with_the_outline():
    stated = "datum = [1.0, 2.0, 30.0]\npicks = {rim = [5, 0, 90]}\noutline_mm = ["
    result = job.parse(TEXT.replace("outline_mm = [", stated, 1))
    shift = result.part.outline_mm[0] - np.array(tomllib.loads(TEXT)["part"]["outline_mm"][0])
    assert np.allclose(result.part.datum, [1.0 + shift[0], 2.0 + shift[1], 30.0])
    again = job.from_canonical(result.canonical())
    assert again.canonical() == result.canonical()
    assert again.part.picks == {"rim": [5.0, 0.0, 90.0]}
    with pytest.raises(InputError, match="need a datum"):
        job.parse(TEXT.replace("outline_mm = [", stated.partition("\n")[2], 1))


def test_schema_fields_stay_few():
    """A value that never differs from job to job is a constant near its use, not a key."""
    assert sum(len(fields) for fields in schema.FIELDS.values()) <= MOST_KEYS
