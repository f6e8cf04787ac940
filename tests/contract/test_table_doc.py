"""TABLE.md lists the fields, grids and numbers that the code has."""

import re
from pathlib import Path

import pytest

from runtime import table_model as model
from runtime.table import FORMAT, FRAME_FIELDS, MAX_BYTES, MAX_DEPTH, PAYLOAD_FIELDS
from runtime.table_columns import MAX_ARRAY_LENGTH

TEXT = (Path(__file__).parents[2] / "runtime" / "TABLE.md").read_text()


def section(title: str) -> str:
    """The text under a heading, up to the next one of the same rank."""
    found = re.search(rf"^## {title}$(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert found is not None, f"TABLE.md has no section {title}"
    return found[1]


def listed(title: str) -> list[tuple[int, str]]:
    """Numbered rows of a section's table: number and field name."""
    return [
        (int(number), name)
        for number, name in re.findall(r"^\| (\d+) \| `(\w+)` \|", section(title), re.MULTILINE)
    ]


@pytest.mark.parametrize(("title", "fields"), [("Frame", FRAME_FIELDS), ("Payload", PAYLOAD_FIELDS)])
def test_fields_are_listed_in_their_order(title: str, fields: tuple[str, ...]) -> None:
    assert listed(title) == list(enumerate(fields))


@pytest.mark.parametrize(
    ("row", "grid"),
    [
        ("widths of a branch", f"{model.WIDTH_GRID_UM} um"),
        ("shares of a node's branches", f"{model.SHARE_GRID_PPM} ppm"),
        ("clearance", f"{model.CLEARANCE_GRID_UM} um"),
        ("predicted pose", f"{model.POSE_GRID_UM} um, {model.POSE_GRID_URAD} urad"),
        ("success of a leaf", f"{model.SHARE_GRID_PPM} ppm"),
    ],
)
def test_grids_are_the_ones_of_the_code(row: str, grid: str) -> None:
    assert f"| {row} | {grid} |" in section("Units")


def test_numbers_in_the_prose_are_the_ones_of_the_code() -> None:
    assert TEXT.startswith(f"# The decision table, format {FORMAT}\n")
    assert f"| squeezetree 0.1 | {FORMAT} |" in TEXT
    assert f"`{model.MAGIC}`" in section("Frame")
    assert f"arrays of at most {MAX_ARRAY_LENGTH}, a file of at most {MAX_BYTES >> 20} MiB" in section(
        "Frame"
    )
    assert f"`max depth` <= {MAX_DEPTH}" in section("What is refused")
    length, angle = model.COVARIANCE_LENGTH_UM, model.COVARIANCE_ANGLE_URAD
    assert f"units of {length} um and {angle // 1000} {angle % 1000:03d} urad" in section("Units")
