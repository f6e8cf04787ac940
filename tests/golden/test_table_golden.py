"""The file of each format version, byte for byte: whoever changes the bytes changes the format's number."""

from dataclasses import replace
from pathlib import Path

import pytest
from sample_tables import every_field_table, small_table, with_job

from runtime.table import Calibration, TableError, canonical, count_map, dumps, loads

FORMAT_1 = (Path(__file__).parent / "table-format-1.msgpack").read_bytes()
FORMAT_2 = (Path(__file__).parent / "table-format-2.msgpack").read_bytes()


def test_format_1_is_read_as_it_was_written() -> None:
    assert loads(FORMAT_1) == with_job(small_table(), '{"seed":1}')


def test_format_1_is_written_again_as_format_2_with_the_same_decisions() -> None:
    old = loads(FORMAT_1)
    new = loads(dumps(old))
    assert new == canonical(old)
    calibration = Calibration.linear(old.gripper)
    for before, after in zip(old.nodes, new.nodes, strict=True):
        assert count_map(before, calibration) == count_map(after, calibration)
    assert replace(new, nodes=old.nodes, leaves=old.leaves) == old


def test_every_damage_to_a_file_of_format_1_is_refused() -> None:
    for at in range(len(FORMAT_1)):
        with pytest.raises(TableError):
            loads(FORMAT_1[:at])
        for bit in range(8):
            damaged = bytearray(FORMAT_1)
            damaged[at] ^= 1 << bit
            with pytest.raises(TableError):
                loads(bytes(damaged))


def test_format_2_is_read() -> None:
    assert loads(FORMAT_2) == canonical(every_field_table())


def test_format_2_is_written_byte_for_byte() -> None:
    assert dumps(every_field_table()) == FORMAT_2
