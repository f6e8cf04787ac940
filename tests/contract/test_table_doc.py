"""TABLE.md lists the sections, fields and limits of the code, and its example is a valid table."""

import re

from programs import ROOT
from sample_tables import small_table

from runtime.table import HELD_UM, dumps
from runtime.table.codec import FORMAT, MAGIC
from runtime.table.fields import FLAG, LINE, MAX_BYTES, MAX_LEAVES, TEXT, Field
from runtime.table.model import KINDS
from runtime.table.sections import SECTIONS, Section

PAGE = (ROOT / "runtime" / "table" / "TABLE.md").read_text()
PROSE = " ".join(PAGE.split())


def section_row(section: Section) -> str:
    """The row that TABLE.md should have for a section: name, number of records, meaning."""
    number = "one record"
    if section.row:
        least = "" if section.least == section.most else f"{section.least}.."
        number = f"{least}{section.most}{f' a {section.owner.name}' if section.owner else ''}"
    if section.optional:
        number += ", optional"
    return f"{section.name:24} {number:27} {section.meaning}"


def field_row(field: Field) -> str:
    """The row that TABLE.md should have for a field: name, type and range, meaning."""
    values = {
        "int": f"{field.least}..{field.most}",
        FLAG: "0 or 1",
        LINE: f"str, {field.least}..{field.most}",
        TEXT: "str",
        "bytes": f"bin, {field.most}",
    }[field.type]
    return f"  {field.name:22} {values:27} {field.meaning}"


def rows() -> list[str]:
    """The rows that TABLE.md should have for all sections and fields."""
    return [
        line
        for section in SECTIONS
        for line in (section_row(section), *map(field_row, section.columns))
    ]


def test_table_page_lists_sections_and_fields_of_code():
    (listed,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    assert listed.splitlines() == rows()


def test_table_page_example_is_file_byte_for_byte():
    (example,) = re.findall(r"```\n([0-9a-f\s]*)```", PAGE)
    assert bytes.fromhex(example) == dumps(small_table())


def test_table_page_states_numbers_of_code():
    assert f"`{MAGIC}` (str), the format {FORMAT} (int)" in PROSE
    assert f"| 1 to {FORMAT - 1} | {FORMAT} |" in PROSE
    assert f"no array is longer than {MAX_LEAVES}, no file than {MAX_BYTES >> 20} MiB" in PROSE
    assert f"expected width >= {HELD_UM} um is a grip" in PROSE
    assert "up to `empty_um`: branches without a grip" in PROSE


def test_table_page_lists_kinds_of_goal():
    listed = re.findall(r"^\| `(\w+)` \| [^|]*\|$", PAGE, re.MULTILINE)
    assert tuple(listed) == KINDS
