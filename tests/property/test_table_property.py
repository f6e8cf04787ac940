"""Random tables: round trip, look-up by the rule, nothing accepted that was not written."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_tables import random_table

from runtime.table import TableError, dumps, loads

CASES = settings(max_examples=30, deadline=None, derandomize=True)
tables = st.builds(random_table, st.integers(0, 10**6), st.integers(1, 25))


@CASES
@given(tables)
def test_a_table_comes_back_from_its_one_file(table) -> None:
    data = dumps(table)
    assert loads(data) == table
    assert dumps(loads(data)) == data


@CASES
@given(tables, st.data())
def test_a_changed_file_is_refused(table, data) -> None:
    written = bytearray(dumps(table))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(written) - 1))
        action = data.draw(st.sampled_from(["flip", "drop", "insert", "repeat"]))
        if action == "flip":
            written[at] ^= data.draw(st.integers(1, 255))
        elif action == "drop":
            del written[at]
        elif action == "insert":
            written.insert(at, data.draw(st.integers(0, 255)))
        else:
            written[at:at] = written[at : at + 16]
    if bytes(written) == dumps(table):
        return
    with pytest.raises(TableError):
        loads(bytes(written))


@CASES
@given(st.binary(max_size=400))
def test_arbitrary_bytes_are_refused_and_nothing_else_happens(data) -> None:
    with pytest.raises(TableError):
        loads(data)
    with pytest.raises(TableError):
        loads(b"\x94\xabsqueezetree\x03" + data)
