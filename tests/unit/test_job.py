"""The job file: what it becomes, and that each mistake is named with its place and a way out."""

import dataclasses
import hashlib
import json
import math
import pickle
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from planner import errors, fields, job, schema
from planner.part import outline

RECTANGLE = Path(__file__).parents[2] / "trees" / "rectangle" / "job.toml"
TEXT = RECTANGLE.read_text(encoding="utf-8")


def edited(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, f"the test expects {old!r} once in the rectangle's job"
    return TEXT.replace(old, new)


@pytest.fixture
def rectangle() -> job.Job:
    return job.load(RECTANGLE)


def test_the_rectangle_is_the_one_of_the_paper(rectangle):
    part = rectangle.part
    assert np.ptp(part.outline_mm, axis=0).tolist() == [30.0, 21.0]
    assert part.symmetry == 2
    assert rectangle.pressure.kind == "boundary"
    assert rectangle.friction == job.Friction(0.4, 0.6)
    gripper = rectangle.gripper
    assert (gripper.finger_length_mm, gripper.finger_width_mm, gripper.opening_mm) == (27.5, 9.5, 85.0)
    assert (gripper.count_open, gripper.count_closed, gripper.encoder_noise_mm) == (3, 230, 0.15)
    assert rectangle.uncertainty == job.Uncertainty(12.75, 180.0)
    assert rectangle.uncertainty.orientation == "unknown"
    assert rectangle.actions.angles_deg == (0.0, 45.0, 90.0, 135.0)
    assert rectangle.actions.centers_mm.tolist() == [[0.0, 0.0]]
    assert rectangle.goal == job.Goal(3.0, 0.99)
    assert rectangle.cell.work_area_mm == ((-150.0, -150.0), (150.0, 150.0))
    assert rectangle.seed == 1


def test_a_job_is_frozen(rectangle):
    with pytest.raises(dataclasses.FrozenInstanceError):
        rectangle.seed = 2
    for array in (rectangle.part.outline_mm, rectangle.actions.centers_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_canonical_text_round_trips_exactly(rectangle):
    text = rectangle.canonical()
    again = job.from_canonical(text)
    assert again == rectangle
    assert again.canonical() == text
    assert hash(again) == hash(rectangle)
    assert text == json.dumps(json.loads(text), sort_keys=True, separators=(",", ":"))
    assert rectangle.digest() == hashlib.sha256(text.encode()).digest()


def test_how_a_job_is_written_does_not_change_its_digest(rectangle):
    without_defaults = re.sub(
        r"(?m)^(symmetry|wishart_dof|model|count_\w+|encoder\w+|speed\w+|force\w+) .*\n", "", TEXT
    )
    assert len(without_defaults) < len(TEXT)
    elsewhere = edited(
        "[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[100.0, 7], [100.0, 28], [130, 28], [130, 7]]"
    )
    for text in (without_defaults, elsewhere, TEXT.replace("\n", "\r\n")):
        assert job.parse(text).digest() == rectangle.digest()
    assert job.parse(edited("seed = 1", "seed = 2")).digest() != rectangle.digest()


def test_a_file_with_a_byte_order_mark_is_read(tmp_path, rectangle):
    path = tmp_path / "job.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    assert job.load(path) == rectangle


def test_support_points_move_with_the_outline():
    points = 'kind = "points"\npoints_mm = [[0, 0], [30, 0], [15, 21]]'
    even = job.parse(edited('kind = "boundary"', points)).pressure
    assert even.points_mm.tolist() == [[-15.0, -10.5], [15.0, -10.5], [0.0, 10.5]]
    assert even.weights.tolist() == [1 / 3] * 3
    weighted = job.parse(edited('kind = "boundary"', points + "\nweights = [1, 2, 4]"))
    assert weighted.pressure.weights.tolist() == [1 / 7, 2 / 7, 4 / 7]
    assert job.from_canonical(weighted.canonical()) == weighted


def test_bounded_orientation_and_stated_ellipsoid_round_trip():
    text = edited('orientation = "unknown"', "orientation_halfwidth_deg = 20")
    text = text.replace(
        '"boundary"', '"stated"\nrho_mm = 10\nellipsoid = [[1, 0, 0], [0, 1, 0.1], [0, 0.1, 0.5]]', 1
    )
    stated = job.parse(text)
    assert stated.uncertainty.orientation == "bounded"
    assert stated.pressure.ellipsoid[1, 2] == 0.1
    assert job.from_canonical(stated.canonical()) == stated


def test_a_marked_rectangle_may_state_no_symmetry():
    assert job.parse(edited('symmetry = "auto"', "symmetry = 1")).part.symmetry == 1


UNKNOWN = [
    ("radius_mm", "radius", "uncertainty", 'did you mean "radius_mm"?'),
    ("opening_mm", "opening_m", "gripper", 'did you mean "opening_mm"?'),
    ("angles_deg", "angels_deg", "actions", 'did you mean "angles_deg"?'),
    ("[friction]", "[frictoin]", "", 'did you mean "friction"?'),
    ("confidence", "zzz", "goal", "valid are distance_mm, confidence"),
    ("[goal]", "[goal]\nopening_mm = 85", "goal", "belongs in [gripper]"),
    ("[goal]", "[goal]\nseed = 85", "goal", "belongs on top"),
    ("seed = 1", "opening_mm = 1", "", "belongs in [gripper]"),
    ("[friction]", "points_mm = [[0, 0], [1, 1]]\n[friction]", "pressure", 'goes with kind = "points"'),
]


@pytest.mark.parametrize(("old", "new", "section", "advice"), UNKNOWN)
def test_an_unknown_name_is_refused_with_the_nearest_valid_one(old, new, section, advice):
    with pytest.raises(errors.KeyNameError) as caught:
        job.parse(TEXT.replace(old, new, 1), "my.toml")
    message = str(caught.value)
    assert message.startswith(f"my.toml: [{section}]" if section else "my.toml: ")
    assert advice in message
    assert "\n" not in message
    assert caught.value.section == section
    assert caught.value.names[0] in message


REQUIRED = [
    (section, key)
    for section, keys in schema.FIELDS.items()
    for key, field in keys.items()
    if field.default is fields.REQUIRED
]


@pytest.mark.parametrize(("section", "key"), [*REQUIRED, ("uncertainty", "orientation")])
def test_a_missing_key_is_named(section, key):
    text = re.sub(rf"(?m)^{key} = .*\n", "", TEXT)
    assert text != TEXT
    with pytest.raises(errors.KeyNameError, match=rf"\[{section}\].*missing key {key}") as caught:
        job.parse(text, "my.toml")
    assert caught.value.names == (key,)


def test_all_missing_sections_are_named_at_once():
    with pytest.raises(errors.KeyNameError) as caught:
        job.parse("[part]\n")
    assert caught.value.names == ("friction", "gripper", "uncertainty", "actions", "goal")


WRONG = [
    ("seed = 1", "seed = -1", "", "seed"),
    ("seed = 1", "seed = true", "", "seed"),
    ('name = "rectangle"', "name = 3", "part", "name"),
    ('name = "rectangle"', 'name = ""', "part", "name"),
    ('name = "rectangle"', 'name = "a\\nb"', "part", "name"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [30, 0, 1]]", "part", "outline_mm"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", '"square"', "part", "outline_mm"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [30, nan], [3, 3]]", "part", "outline_mm"),
    ('symmetry = "auto"', "symmetry = 4", "part", "symmetry"),
    ('symmetry = "auto"', "symmetry = 0", "part", "symmetry"),
    ('symmetry = "auto"', 'symmetry = "none"', "part", "symmetry"),
    ('kind = "boundary"', 'kind = "bondary"', "pressure", "kind"),
    ('kind = "boundary"', "kind = 2", "pressure", "kind"),
    ("wishart_dof = 100", "wishart_dof = 2", "pressure", "wishart_dof"),
    ("wishart_dof = 100", "wishart_dof = 100.5", "pressure", "wishart_dof"),
    ("finger_part_min = 0.4", "finger_part_min = 0.7", "friction", "finger_part_min"),
    ("finger_part_max = 0.6", "finger_part_max = 2.1", "friction", "finger_part_max"),
    ("finger_part_min = 0.4", "finger_part_min = -0.1", "friction", "finger_part_min"),
    ("finger_part_min = 0.4", "finger_part_min = nan", "friction", "finger_part_min"),
    ("opening_mm = 85.0", "opening_mm = inf", "gripper", "opening_mm"),
    ("opening_mm = 85.0", "opening_mm = 0", "gripper", "opening_mm"),
    ("opening_mm = 85.0", 'opening_mm = "85"', "gripper", "opening_mm"),
    ("opening_mm = 85.0", "opening_mm = 1979-05-27", "gripper", "opening_mm"),
    ("opening_mm = 85.0", "opening_mm = " + "9" * 400, "gripper", "opening_mm"),
    ("count_closed = 230", "count_closed = 256", "gripper", "count_closed"),
    ("count_open = 3", "count_open = 230", "gripper", "count_open"),
    ("speed_mm_s = 60.0", "speed_mm_s = 151", "gripper", "speed_mm_s"),
    ("force_n = 40.0", "force_n = 236", "gripper", "force_n"),
    ('orientation = "unknown"', 'orientation = "known"', "uncertainty", "orientation"),
    ("[actions]", "orientation_halfwidth_deg = 20\n[actions]", "uncertainty", "orientation"),
    ("[0, 45, 90, 135]", "[]", "actions", "angles_deg"),
    ("[0, 45, 90, 135]", "[0, 45, 0.0]", "actions", "angles_deg"),
    ("[0, 45, 90, 135]", "45", "actions", "angles_deg"),
    ("centers_mm = [[0, 0]]", "centers_mm = [0, 0]", "actions", "centers_mm"),
    ("centers_mm = [[0, 0]]", "centers_mm = [[0, 0], [0, 151]]", "actions", "centers_mm"),
    ("distance_mm = 3.0", "distance_mm = 0", "goal", "distance_mm"),
    ("confidence = 0.99", "confidence = 1", "goal", "confidence"),
    ("[goal]", "[search]\ndepth = 0\n[goal]", "search", "depth"),
    ("[goal]", "[search]\nmethod = 'open-loop'\n[goal]", "search", "method"),
    ("[goal]", "[cell]\nwork_area_mm = [[9, -9], [-9, 9]]\n[goal]", "cell", "work_area_mm"),
    ("[goal]", "[cell]\nwork_area_mm = [[-9, -9]]\n[goal]", "cell", "work_area_mm"),
    ('"boundary"', '"points"\npoints_mm = [[0, 0], [0, 22]]', "pressure", "points_mm"),
    ('"boundary"', '"points"\npoints_mm = [[1, 1], [1, 1]]', "pressure", "points_mm"),
    ('"boundary"', '"points"\npoints_mm = [[1, 1], [2, 1]]\nweights = [1, 2, 3]', "pressure", "weights"),
    ('"boundary"', '"points"\npoints_mm = [[1, 1], [2, 1]]\nweights = [1, 0]', "pressure", "weights"),
    ('"boundary"', '"stated"\nrho_mm = 9\nellipsoid = [[1, 0, 0], [0, 1, 1], [0, 1, 1]]', "pressure", "ellipsoid"),  # noqa: E501
    ('"boundary"', '"stated"\nrho_mm = 9\nellipsoid = [[1, 1, 0], [0, 1, 0], [0, 0, 1]]', "pressure", "ellipsoid"),  # noqa: E501
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "section", "key"), WRONG)
def test_a_wrong_value_is_refused_at_its_place(old, new, section, key):
    with pytest.raises(errors.ValueRangeError) as caught:
        job.parse(TEXT.replace(old, new, 1), "my.toml")
    error = caught.value
    assert (error.section, error.key, error.where) == (section, key, "my.toml")
    assert str(error).startswith(f"my.toml: [{section}] {key}: " if section else f"my.toml: {key}: ")
    assert "\n" not in str(error)
    assert len(str(error)) < 250


def test_a_value_in_place_of_a_section_is_refused():
    for text in ("goal = 3\n" + TEXT.partition("[goal]")[0], edited("[goal]", "[[goal]]")):
        with pytest.raises(errors.ValueRangeError, match=r"\[goal\]: must be a section"):
            job.parse(text)


def test_outline_errors_name_file_and_key():
    crossing = edited("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [30, 21], [30, 0], [0, 21]]")
    with pytest.raises(errors.OutlineError, match=r"my.toml: \[part\] outline_mm: .* at \(15, 10.5\)"):
        job.parse(crossing, "my.toml")


def test_only_the_narrowest_width_must_fit_between_the_jaws():
    bar = edited("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [120, 0], [120, 84.9], [0, 84.9]]")
    assert outline.min_width(job.parse(bar).part.outline_mm) == pytest.approx(84.9)
    for height in ("85", "90"):
        with pytest.raises(errors.FitError, match="part larger than the opening") as caught:
            job.parse(bar.replace("84.9", height))
        assert caught.value.value == 85.0


def test_broken_toml_gives_line_and_column():
    with pytest.raises(errors.TomlError, match="line 2, column 8") as caught:
        job.parse("seed = 1\nname = = 2\n", "my.toml")
    assert (caught.value.line, caught.value.column) == (2, 8)
    with pytest.raises(errors.TomlError, match="line 3") as caught:
        job.parse("[part]\n\noutline_mm = [[0, 0]")
    assert caught.value.line == 3
    for text in ("[part]\n[part]", "x = " + "[" * 100_000, "seed = " + "9" * 10_000, "\x00"):
        with pytest.raises(errors.TomlError, match="not valid TOML"):
            job.parse(text)


def test_unreadable_files_are_named(tmp_path):
    latin = tmp_path / "latin.toml"
    latin.write_bytes("name = 'Würfel'".encode("latin-1"))
    for path, reason in (
        (tmp_path / "absent.toml", "No such file"),
        (tmp_path, "Is a directory"),
        (latin, r"not UTF-8 text \(byte 10\)"),
        ("a\0b", "null"),
    ):
        with pytest.raises(errors.InputFileError, match=reason) as caught:
            job.load(path)
        assert caught.value.where == str(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000])
def test_canonical_text_that_is_not_a_json_object_is_refused(text):
    with pytest.raises(errors.TomlError, match="compile the job again"):
        job.from_canonical(text)


def test_canonical_text_with_a_foreign_outline_is_refused(rectangle):
    document = json.loads(rectangle.canonical())
    document["part"]["outline_mm"] = [[0, 0], [30, 0], [30, 21], [0, 21]]
    with pytest.raises(errors.OutlineError, match="from the origin"):
        job.from_canonical(json.dumps(document))
    document["friction"]["finger_part_min"] = math.nan
    with pytest.raises(errors.JobError):
        job.from_canonical(json.dumps(document))


def test_every_error_class_has_its_own_exit_code_and_survives_a_process_boundary():
    classes = [value for value in vars(errors).values() if isinstance(value, type)]
    leaves = [cls for cls in classes if issubclass(cls, errors.PlannerError) and not cls.__subclasses__()]
    assert sorted(cls.exit_code for cls in leaves) == [2, 3, 4, 5, 6, 7, 8, 9]
    for cls in leaves:
        assert re.search(rf"{cls.__name__} +{cls.exit_code} ", errors.__doc__)
    with pytest.raises(errors.KeyNameError) as caught:
        job.parse("sede = 1", "my.toml")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value)
    assert vars(copy) == vars(caught.value)


def test_the_schema_and_the_records_name_the_same_keys():
    records = {field.name: field.type for field in dataclasses.fields(job.Job)} | {"seed": None}
    assert set(records) == {*schema.FIELDS, *schema.TOP_LEVEL}
    for section, keys in schema.FIELDS.items():
        record = getattr(job, section.capitalize())
        names = {field.name for field in dataclasses.fields(record)}
        further = (
            {key for kind in schema.PRESSURE_FIELDS.values() for key in kind}
            if section == "pressure"
            else set()
        )
        assert names | {"orientation"} == {*keys} | further | {"orientation"}


def test_the_jobs_defaults_are_valid_and_the_example_states_only_known_keys():
    stated = tomllib.loads(TEXT)
    for section, keys in schema.FIELDS.items():
        assert set(stated.get(section, {})) <= set(keys)
        for field in keys.values():
            if field.default is not fields.REQUIRED and field.default is not None:
                field.read(field.default)


def test_reading_a_job_loads_no_heavy_package():
    heavy = ("numba", "sklearn", "scipy", "matplotlib")
    code = f"import planner.job, sys; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=RECTANGLE.parents[2], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"
