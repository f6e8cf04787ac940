"""TABLE.md lists the fields, grids and numbers that the code has."""

import re
from pathlib import Path

import pytest
from runtime.table_codec import READERS
from runtime.table_columns import MAX_ARRAY_LENGTH
from runtime.table_deflate import DYNAMIC_FROM
from sample_tables import GRIPPER

from runtime import table_grid as grid
from runtime import table_model as model
from runtime.table import FORMAT, FRAME_FIELDS, MAX_BYTES, MAX_DEPTH, PAYLOAD_FIELDS

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
    ("row", "content"),
    [
        ("expected width", f"1/{grid.QUARTERS} count"),
        ("shares of a node's branches", f"{model.SHARE_GRID_PPM} ppm"),
        (
            "placement, release, predicted pose",
            f"{model.POSE_GRID_UM} um, 1/{model.ANGLES_PER_TURN} turn",
        ),
        ("clearance", f"{model.CLEARANCE_GRID_UM} um, four numbers to the octave"),
        ("covariance", f"1/{grid.EIGHTHS} of the greatest its variances allow"),
    ],
)
def test_grids_are_the_ones_of_the_code(row: str, content: str) -> None:
    assert f"| {row} | {content} |" in section("Units")


def test_numbers_in_the_prose_are_the_ones_of_the_code() -> None:
    assert TEXT.startswith(f"# The decision table, format {FORMAT}\n")
    assert f"| squeezetree 0.1 | {', '.join(map(str, READERS))} | {FORMAT} |" in TEXT
    assert f"`{model.MAGIC}`" in section("Frame")
    assert f"arrays of at most {MAX_ARRAY_LENGTH}, a file of at most {MAX_BYTES >> 20} MiB" in section(
        "Frame"
    )
    assert f"`max depth` <= {MAX_DEPTH}" in section("What is refused")
    length, angle = model.COVARIANCE_LENGTH_UM, model.COVARIANCE_ANGLE_URAD
    assert f"units of {length} um and {angle // 1000} {angle % 1000:03d} urad" in section("Units")
    assert 1 << grid.SPREAD_BITS == 4
    assert f"below {DYNAMIC_FROM} bytes one block" in section("Payload")
    assert TEXT.count(f">= {model.HELD_UM}") + TEXT.count(f">=\n{model.HELD_UM}") == 2


def test_the_kinds_of_goal_are_listed_by_their_numbers() -> None:
    assert listed("In memory") == list(enumerate(model.KINDS))


def test_what_is_said_of_spread_numbers_is_so() -> None:
    for number in range(8, grid.MAX_SPREAD_NUMBER + 1):
        shift = number // 4 - 1
        assert grid.spread(number) == (number - 4 * shift) << shift
    assert list(map(grid.spread, range(8))) == list(range(8))


def test_the_widths_of_interval_ends_are_as_said() -> None:
    gripper = GRIPPER
    ends = grid.WidthGrid.of(gripper).ends_um
    counts = gripper.count_closed - gripper.count_open
    for number in range(1, counts + 1):
        assert abs(ends[number] - gripper.opening_um * (number - 0.5) / counts) <= 0.5
    assert (ends[0], ends[-1], len(ends)) == (0, gripper.opening_um, counts + 2)
