"""TABLE.md lists the fields, ranges and bytes that the code has, and its example is a table."""

import re
from pathlib import Path

from runtime.table.proof import MAX_ANGLE_URAD
from sample_tables import small_table

from runtime.table import HELD_UM, KINDS, UNDETECTED_UM, decide, decision_map, loads
from runtime.table.codec import (
    FORMAT,
    MAGIC,
    MAX_BYTES,
    PAYLOAD_FIELDS,
    PUSH_FIELDS,
    PUSHING,
    PUSHING_SEVERAL,
    SEVERAL,
    SEVERAL_FIELDS,
)
from runtime.table.lookup import REJECT, Calibration
from runtime.table.model import (
    MAX_ALTERNATIVES,
    MAX_BRANCHES,
    MAX_DEPTH,
    MAX_HYPOTHESES,
    MAX_LEAVES,
    MAX_PUSHES,
)

TEXT = (Path(__file__).parents[2] / "runtime" / "table" / "TABLE.md").read_text()
ROWS = re.findall(r"^\| (\d+) \| `(\w+)` \|.*\| `([0-9a-f]+)` \|$", TEXT, re.MULTILINE)


def test_fields_are_listed_in_their_order() -> None:
    assert [(int(number), name) for number, name, _ in ROWS] == list(enumerate(PAYLOAD_FIELDS))


def test_the_fields_of_format_4_follow_in_their_order() -> None:
    listed = re.findall(r"^\| (4[1-7]) \| `(\w+)` \| [^|]*\| [^|]*\|$", TEXT, re.MULTILINE)
    first = len(PAYLOAD_FIELDS)
    assert [(int(number), name) for number, name in listed] == list(
        enumerate(SEVERAL_FIELDS, first)
    )
    assert f"format {SEVERAL}\n" in TEXT
    assert f"2 to {MAX_HYPOTHESES} names" in TEXT


def test_the_fields_of_pushes_follow_in_their_order() -> None:
    listed = re.findall(r"^\| `(\w+)` \| int a (?:node|push) \| [^|]*\|$", TEXT, re.MULTILINE)
    assert tuple(listed) == PUSH_FIELDS
    assert f"formats {PUSHING} and {PUSHING_SEVERAL}\n" in TEXT
    first = len(PAYLOAD_FIELDS)
    assert f"has the number {first} or {first + len(SEVERAL_FIELDS)}. " in TEXT
    assert f"come before its squeeze, 0..{MAX_PUSHES} |" in TEXT


def test_the_example_is_a_file_byte_for_byte() -> None:
    (frame,) = re.findall(r"```\n(.*?)```", TEXT, re.DOTALL)
    data = bytes.fromhex(frame) + b"".join(bytes.fromhex(row) for *_, row in ROWS)
    assert f"these\n{len(bytes.fromhex(frame))} bytes" in TEXT
    assert loads(data) == small_table()


def test_what_is_said_of_the_example_is_so() -> None:
    table = small_table()
    calibration = Calibration.linear(table.gripper)
    root = decision_map(table.nodes[0], calibration)
    assert "reads count 174 (20.97 mm) with an object felt as branch 0, which is leaf 0" in TEXT
    assert calibration.width_um(174) == 20_969
    assert (decide(root, 174, felt=True), decide(root, 174, felt=False)) == (0, REJECT)
    assert table.nodes[0].branches[0].target == ~0


def test_numbers_in_the_prose_are_the_ones_of_the_code() -> None:
    assert TEXT.startswith(f"# The decision table, format {FORMAT}\n")
    assert f"`{MAGIC}` (str), the format {FORMAT} (int)" in TEXT
    assert f"no array is longer than {MAX_LEAVES}, no file than {MAX_BYTES >> 20} MiB" in TEXT
    assert f"max depth (1..{MAX_DEPTH})" in TEXT
    assert f"how many branches it has, 1..{MAX_BRANCHES}" in TEXT
    assert f"how many alternatives it has, 0..{MAX_ALTERNATIVES}" in TEXT
    angle = f"{MAX_ANGLE_URAD:,}".replace(",", " ")
    assert TEXT.count(f"-{angle}..{angle}") == 3
    assert f"expected width >= {HELD_UM} um is a grip" in TEXT
    assert f"up to {UNDETECTED_UM} um: what means that nothing is held" in TEXT


def test_the_kinds_of_goal_are_listed_by_their_numbers() -> None:
    listed = re.findall(r"^\| (\d) \| `(\w+)` \| [^|]*\|$", TEXT, re.MULTILINE)
    assert [(int(number), name) for number, name in listed] == list(enumerate(KINDS))
