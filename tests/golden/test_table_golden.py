"""A file of the current table format, byte for byte: a change of its bytes needs a new format number."""

from pathlib import Path

from sample_tables import every_field_table

from runtime.table import dumps, loads

GOLDEN = (Path(__file__).parent / "table-format-12.msgpack").read_bytes()


def test_table_golden_file_is_read_and_written_byte_for_byte():
    assert loads(GOLDEN) == every_field_table()
    assert dumps(every_field_table()) == GOLDEN
