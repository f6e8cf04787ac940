"""Values of a job that the command line replaces: the same checks and messages as for the file."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rectangle import JOB_PATH, TEXT, edited

from planner.errors import FitError, KeyNameError
from planner.job import model as job
from planner.job.overrides import changes_of, split, value_of
from runtime.shell.errors import InputError, UsageError

PARSED = job.parse(TEXT)
RADIUS = {"uncertainty.radius_mm": "15", "seed": "4"}


def test_overrides_of_a_path_a_text_or_a_job_equal_the_edited_file():
    text = edited("radius_mm = 12.75", "radius_mm = 15").replace("seed = 1", "seed = 4")
    wanted = job.parse(text)
    changes = changes_of(f"{name}={value}" for name, value in RADIUS.items())
    assert job.load(JOB_PATH, changes) == wanted
    assert job.parse(TEXT, changes=changes) == wanted
    assert PARSED.replaced(**changes) == wanted


def test_overrides_of_another_kind_of_pressure_drop_the_keys_of_the_old():
    points = {"kind": "points", "points_mm": [[5, 5], [25, 5], [15, 15]]}
    changes = {"pressure": {**points, "limit_surface": "quartic"}}
    on_points = job.parse(TEXT, changes=changes)
    assert (on_points.pressure.kind, on_points.pressure.limit_surface) == ("points", "quartic")
    stated = {"kind": "stated", "ellipsoid": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "rho_mm": 10}
    assert on_points.replaced(pressure=stated).pressure.kind == "stated"


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ("uncertainty.radius_mm=-1", InputError, "[uncertainty] radius_mm"),
        ("uncertainty.radius_mm=wide", InputError, "must be a number"),
        ("uncertainty.radius=3", KeyNameError, 'did you mean "radius_mm"'),
        ("uncertanty.radius_mm=3", KeyNameError, 'did you mean "uncertainty"'),
        ("seed.x=3", UsageError, "no section"),
        ("gripper.opening_mm=20", FitError, "part larger than the opening"),
        ("friction.finger_part_min=0.9", InputError, "exchange them"),
    ],
)
def test_overrides_that_a_file_may_not_state_are_refused(change, error, words):
    with pytest.raises(error) as caught:
        PARSED.replaced(**changes_of([change]))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_changes_of_repeated_key_keeps_the_last_value():
    texts = ["a.b=1", "a.c=2", "a.b=3", 'c.d="x=y"', "seed = 4"]
    assert changes_of(texts) == {"a": {"c": 2, "b": 3}, "c": {"d": "x=y"}, "seed": 4}
    assert list(changes_of(texts)["a"]) == ["c", "b"]  # they are applied in this order


@pytest.mark.parametrize("texts", [["seed"], ["seed=1", "seed.x=2"], ["=1"]])
def test_changes_of_malformed_override_is_refused(texts):
    with pytest.raises(UsageError, match="write it as"):
        changes_of(texts)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("1e-3", 1e-3),
        ("true", True),
        ('"a b"', "a b"),
        ("closed-loop", "closed-loop"),
        ("[0, 90]", [0, 90]),
        (" 3 ", 3),
    ],
)
def test_value_of_toml_or_unquoted_word_returns_its_value(text, value):
    assert value_of("a.b", text) == value


@pytest.mark.parametrize("text", ["", "1\nother = 2", "[1, 2", "a b", "1,2", "# nothing", "\x00"])
def test_value_of_invalid_text_is_refused(text):
    with pytest.raises(UsageError) as caught:
        value_of("goal.distance_mm", text)
    assert str(caught.value).startswith("goal.distance_mm: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["", ".", "a.", ".b", "a.b.c", "a b", "a\nb"])
def test_value_of_invalid_name_is_refused(name):
    with pytest.raises(UsageError, match="is not a key of a job"):
        value_of(name, "1")


@pytest.mark.parametrize("text", ["", "a.b", "=1", "a.b=", "a.b=1,,2", "a.b=1,"])
def test_split_malformed_sweep_is_refused(text):
    with pytest.raises(UsageError, match="write it as"):
        split(text)


@settings(max_examples=40, deadline=None)
@given(st.text(max_size=60))
def test_split_and_value_of_any_text_return_or_refuse_in_one_line(text):
    for read in (split, lambda text: value_of("a.b", text)):
        try:
            read(text)
        except UsageError as error:
            message = str(error)
        else:
            message = "read"
        assert message.isprintable()
