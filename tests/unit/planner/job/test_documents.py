"""Changes to the document of a job, as `--vary` and `--world-set` make them."""

import pytest

from planner.job import model as job_file
from runtime.shell.errors import InputError


def text(*fragments: str) -> str:
    """A job of two parts and a foreign part, with further TOML for each of the three."""
    return """
        seed = 1
        friction = {finger_part_min = 0.4, finger_part_max = 0.6}
        gripper = {finger_length_mm = 27.5, finger_width_mm = 9.5, opening_mm = 85.0}
        uncertainty = {radius_mm = 10, orientation = "unknown"}
        actions = {angles_deg = [0, 45, 90, 135], centers_mm = [[0, 0]]}
        goal = {distance_mm = 3.0, confidence = 0.99}
        """ + "".join(
        f"""
        [[{key}]]
        name = "{width} mm"
        part = {{outline_mm = [[0, 0], [45, 0], [45, {width}], [0, {width}]]}}
        {fragment}
        """
        for key, width, fragment in zip(
            ("hypothesis", "hypothesis", "stranger"), (12, 17, 21), fragments, strict=True
        )
    )


STATED = "friction = {finger_part_min = 0.2, finger_part_max = 0.25}"


@pytest.mark.parametrize("as_file", [True, False], ids=["text of a file", "canonical document"])
@pytest.mark.parametrize(
    "fragments", [("", "", ""), ("", STATED, STATED)], ids=["shared", "stated"]
)
def test_changed_friction_reaches_each_part_and_foreign_part(as_file, fragments):
    changes = {"friction": {"finger_part_min": 0.1}}
    if as_file:
        job = job_file.parse(text(*fragments), "the job", changes)
    else:
        job = job_file.parse(text(*fragments), "the job").replaced(**changes)
    bounds = [alone.friction for alone in (*job.alone, *job.foreign_parts)]
    assert [each.finger_part_min for each in bounds] == [0.1] * 3
    highest = [0.25 if fragment else 0.6 for fragment in fragments]
    assert [each.finger_part_max for each in bounds] == highest


def test_changed_entries_that_are_no_list_are_refused():
    document = text("", "", "").partition("\n        [[")[0] + "\nhypothesis = 3"
    with pytest.raises(InputError, match="2 to 16 entries"):
        job_file.parse(document, "the job", {"friction": {"finger_part_min": 0.1}})
