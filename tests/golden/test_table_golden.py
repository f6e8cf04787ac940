"""The file of each format version, byte for byte: whoever changes the bytes changes the format's number."""

from pathlib import Path

from sample_tables import random_table, small_table, with_job

from runtime.table import canonical, dumps, loads

FORMAT_1 = Path(__file__).parent / "table-format-1.msgpack"


def test_format_1_is_read() -> None:
    assert loads(FORMAT_1.read_bytes()) == canonical(with_job(small_table(), '{"seed":1}'))


def test_format_1_is_written_byte_for_byte() -> None:
    assert dumps(with_job(small_table(), '{"seed":1}')) == FORMAT_1.read_bytes()


def test_compact_enough_to_mail() -> None:
    table = random_table(0, 140)
    assert len(dumps(table)) <= 18 * (len(table.nodes) + len(table.leaves))
