"""Properties of jobs: the canonical text is exact for any job, and only an InputError escapes the reader."""

import json
import math
from collections.abc import Callable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import JOB

from planner.job import model as job
from runtime.shell.errors import InputError

RECTANGLE = job.load(JOB)
DOCUMENT = json.loads(RECTANGLE.canonical())
SECTIONS = {section: table for section, table in DOCUMENT.items() if isinstance(table, dict)}
PLACES = [(section, key) for section, table in SECTIONS.items() for key in table]

radii = st.lists(st.floats(3.0, 40.0), min_size=3, max_size=24)
shifts = st.tuples(st.floats(-1000.0, 1000.0), st.floats(-1000.0, 1000.0))
anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


def star(lengths: list[float], shift: tuple[float, float]) -> np.ndarray:
    """A star-shaped polygon: its vertices are at these distances from the middle, at even angles."""
    angles = np.arange(len(lengths)) * math.tau / len(lengths)
    return np.array(lengths)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) + shift


@settings(max_examples=60)
@given(radii, shifts, st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.integers(0, 2**63 - 1))
def test_job_canonical_text_round_trips_exactly(lengths, shift, low, high, seed):
    drawn = star(lengths, shift).tolist()
    low, high = sorted((low, high))
    text = (
        f"seed = {seed}\n[part]\nname = 'star'\noutline_mm = {drawn}\n"
        f"[friction]\nfinger_part_min = {low!r}\nfinger_part_max = {high!r}\n"
        "[gripper]\nfinger_length_mm = 27.5\nfinger_width_mm = 9.5\nopening_mm = 85\n"
        "[uncertainty]\nradius_mm = 10\norientation = 'unknown'\n"
        "[actions]\nangles_deg = [0]\ncenters_mm = [[0, 0]]\n[goal]\ndistance_mm = 3\nconfidence = 0.9\n"
    )
    first = job.parse(text)
    second = job.from_canonical(first.canonical())
    assert second.canonical() == first.canonical()
    assert second.digest() == first.digest()
    assert np.array_equal(second.part.outline_mm, first.part.outline_mm)
    assert (second.friction.finger_part_min, second.friction.finger_part_max, second.seed) == (
        low,
        high,
        seed,
    )


def refusal(read: Callable[[str, str], job.Job], text: str) -> InputError | None:
    """The error with which a text is refused; None if it is read. Any other exception fails the test."""
    try:
        read(text, "my.toml")
    except InputError as error:
        return error
    return None


@settings(max_examples=150)
@given(st.sampled_from(PLACES), anything)
def test_from_canonical_any_value_gives_job_or_one_line_error(place, value):
    section, key = place
    document = DOCUMENT | {section: DOCUMENT[section] | {key: value}}
    error = refusal(job.from_canonical, json.dumps(document))
    assert error is None or error.exit_code in range(3, 9)
    assert error is None or str(error).startswith("my.toml: ")
    assert "\n" not in str(error)


@settings(max_examples=100)
@given(st.text(alphabet=st.sampled_from("[]{}=\"'.,#\n part1e9_\\x\x00é"), max_size=60))
def test_parse_any_text_gives_one_line_error(text):
    error = refusal(job.parse, text)
    assert error is not None
    assert "\n" not in str(error)
