"""Mistakes in a job file: the error states the place and the remedy."""

import re

import pytest
from rectangle import TEXT, edited

from planner.errors import FitError, KeyNameError
from planner.job import fields, schema
from planner.job import model as job
from planner.part import outline
from runtime.shell.errors import InputError

UNKNOWN = [
    ("radius_mm", "radius", "uncertainty", 'did you mean "radius_mm"?'),
    ("[friction]", "[frictoin]", "", 'did you mean "friction"?'),
    ("confidence", "zzz", "goal", "valid are kind, distance_mm, confidence"),
    ("[goal]", "[goal]\nopening_mm = 85", "goal", "belongs in [gripper]"),
    ("seed = 1", "opening_mm = 1", "", "belongs in [gripper]"),
    (
        "[friction]",
        "points_mm = [[0, 0], [1, 1]]\n[friction]",
        "pressure",
        'goes with kind = "points"',
    ),
]


@pytest.mark.parametrize(("old", "new", "section", "advice"), UNKNOWN)
def test_parse_unknown_name_is_refused_with_the_valid_one(old, new, section, advice):
    with pytest.raises(KeyNameError) as caught:
        job.parse(TEXT.replace(old, new, 1), "my.toml")
    message = str(caught.value)
    assert message.startswith(f"my.toml: [{section}]" if section else "my.toml: ")
    assert advice in message
    assert "\n" not in message
    assert caught.value.section == section


@pytest.mark.parametrize(
    ("section", "key", "instead"),
    [(section, key, text) for section, keys in schema.FORMER.items() for key, text in keys.items()],
)
def test_parse_former_key_is_refused_with_its_replacement(section, key, instead):
    heads = {"actions": "[actions]", "doubt": "[doubt]"}
    text = TEXT if heads[section] in TEXT else f"{TEXT}\n{heads[section]}\n"
    with pytest.raises(KeyNameError, match=rf"\[{section}\]: key '{key}' is") as caught:
        job.parse(text.replace(heads[section], f'{heads[section]}\n{key} = "any"', 1), "my.toml")
    assert str(caught.value).endswith(instead)


REQUIRED = [
    (section, key)
    for section, keys in schema.FIELDS.items()
    for key, field in keys.items()
    if field.default is fields.REQUIRED and section not in schema.ABSENT_SECTIONS
]


@pytest.mark.parametrize(("section", "key"), [*REQUIRED, ("uncertainty", "orientation")])
def test_parse_missing_key_is_refused_and_named(section, key):
    text = re.sub(rf"(?m)^{key} = .*\n", "", TEXT)
    assert text != TEXT
    with pytest.raises(KeyNameError, match=rf"my.toml: \[{section}\].*missing key {key};"):
        job.parse(text, "my.toml")


def test_parse_missing_sections_are_all_named():
    missing = "friction, gripper, uncertainty, actions, goal"
    with pytest.raises(KeyNameError, match=f"missing sections {missing}; add them"):
        job.parse("[part]\n")


POINTS = '"points"\npoints_mm = [[1, 1], [2, 1]]'
STATED = '"stated"\nrho_mm = 9\nellipsoid'
WRONG = [
    ("seed = 1", "seed = -1", "", "seed"),
    ('name = "rectangle"', 'name = ""', "part", "name"),
    ('name = "rectangle"', 'name = "a\\nb"', "part", "name"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [30, 0, 1]]", "part", "outline_mm"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", f"[{'[0, 1], ' * 2001}]", "part", "outline_mm"),
    ("[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [30, nan], [3, 3]]", "part", "outline_mm"),
    ('symmetry = "auto"', "symmetry = 4", "part", "symmetry"),
    ("wishart_dof = 100", "wishart_dof = 100.5", "pressure", "wishart_dof"),
    ("finger_part_min = 0.4", "finger_part_min = 0.7", "friction", "finger_part_min"),
    ("finger_part_max = 0.6", "finger_part_max = 2.1", "friction", "finger_part_max"),
    ("opening_mm = 85.0", 'opening_mm = "85"', "gripper", "opening_mm"),
    ("opening_mm = 85.0", "opening_mm = " + "9" * 400, "gripper", "opening_mm"),
    ("noise_mm = 0.15", "resolution_mm = 0", "gripper", "resolution_mm"),
    ("robotiq-2f-85", "some gripper", "gripper", "model"),
    ("distance_mm = 3.0", "distance_mm = 1e-6", "goal", "distance_mm"),
    ("speed_mm_s = 60.0", "speed_mm_s = 151", "gripper", "speed_mm_s"),
    ("speed_mm_s = 60.0", "speed_mm_s = 19", "gripper", "speed_mm_s"),
    ("force_n = 40.0", "force_n = 236", "gripper", "force_n"),
    ("force_n = 40.0", "force_n = 19", "gripper", "force_n"),
    ("robotiq-2f-85", "schunk-egu", "gripper", "force_n"),
    ('orientation = "unknown"', 'orientation = "known"', "uncertainty", "orientation"),
    ("[actions]", "orientation_halfwidth_deg = 20\n[actions]", "uncertainty", "orientation"),
    ("[0, 45, 90, 135]", "[0, 45, 0.0]", "actions", "angles_deg"),
    ("centers_mm = [[0, 0]]", "centers_mm = [[0, 0], [0, 151]]", "actions", "centers_mm"),
    ("[goal]", "[search]\nmax_depth = 0\n[goal]", "search", "max_depth"),
    ("[goal]", "[search]\nmethod = 'open-loop'\n[goal]", "search", "method"),
    ("[goal]", "[cell]\nwork_area_mm = [[9, -9], [-9, 9]]\n[goal]", "cell", "work_area_mm"),
    ('"boundary"', '"points"\npoints_mm = [[0, 0], [0, 22]]', "pressure", "points_mm"),
    ('"boundary"', f"{POINTS}\nweights = [1, 2, 3]", "pressure", "weights"),
    ('"boundary"', f"{POINTS}\nweights = [1, 0]", "pressure", "weights"),
    ('"boundary"', f"{STATED} = [[1, 0, 0], [0, 1, 1], [0, 1, 1]]", "pressure", "ellipsoid"),
    ('"boundary"', f"{STATED} = [[1, 1, 0], [0, 1, 0], [0, 0, 1]]", "pressure", "ellipsoid"),
]


@pytest.mark.parametrize(("old", "new", "section", "key"), WRONG)
def test_parse_wrong_value_is_refused_at_its_place(old, new, section, key):
    with pytest.raises(InputError) as caught:
        job.parse(TEXT.replace(old, new, 1), "my.toml")
    error = caught.value
    assert (error.section, error.key, error.where) == (section, key, "my.toml")
    place = f"[{section}] {key}" if section else key
    assert str(error).startswith(f"my.toml: {place}: ")
    assert "\n" not in str(error)
    assert len(str(error)) < 250


def test_parse_value_in_place_of_a_section_is_refused():
    for text in ("goal = 3\n" + TEXT.partition("[goal]")[0], edited("[goal]", "[[goal]]")):
        with pytest.raises(InputError, match=r"\[goal\]: must be a section"):
            job.parse(text)


def test_parse_part_is_refused_only_if_no_width_fits_the_jaws():
    bar = edited(
        "[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0, 0], [120, 0], [120, 84.9], [0, 84.9]]"
    )
    assert outline.min_width(job.parse(bar).part.outline_mm) == pytest.approx(84.9)
    for height in ("85", "90"):
        with pytest.raises(FitError, match=r"part larger than the opening.* the jaws open 85 mm"):
            job.parse(bar.replace("84.9", height))
