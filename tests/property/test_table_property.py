"""Random tables: round trip, one file a table, look-up by the rule, nothing accepted that was not written."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runtime.table_columns import column, unzigzag, values, zigzag
from sample_tables import random_table, renumbered

from runtime.table import REJECT, Calibration, TableError, canonical, count_map, dumps, loads

CASES = settings(max_examples=60, deadline=None, derandomize=True)
tables = st.builds(random_table, st.integers(0, 10**6), st.integers(1, 25))
falling = st.lists(st.integers(0, 90_000), min_size=256, max_size=256).map(lambda w: sorted(w, reverse=True))


@CASES
@given(tables, st.integers(0, 10**6))
def test_a_tree_has_one_file_whatever_its_numbers(table, seed) -> None:
    data = dumps(table)
    assert loads(data) == canonical(table)
    assert dumps(loads(data)) == data
    assert dumps(renumbered(table, seed)) == data


@CASES
@given(tables, falling)
def test_a_count_means_the_nearest_branch_that_contains_its_width(table, widths) -> None:
    calibration = Calibration(tuple(widths))
    for node in table.nodes[:3]:
        outcomes = count_map(node, calibration)
        assert len(outcomes) == 256
        for count, outcome in enumerate(outcomes):
            width = calibration.width_um(count)
            distances = {
                number: abs(width - branch.expected_um)
                for number, branch in enumerate(node.branches)
                if branch.low_um <= width <= branch.high_um
            }
            assert (outcome == REJECT) == (not distances)
            assert outcome == REJECT or distances[outcome] == min(distances.values())


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
        loads(b"\x94\xabsqueezetree\x01" + data)


@given(st.lists(st.integers(0, 2**35 - 1)))
@settings(deadline=None, derandomize=True)
def test_columns_come_back(numbers) -> None:
    assert values(column(numbers), "numbers", len(numbers)) == numbers


@given(st.integers(-(2**34), 2**34 - 1))
@settings(deadline=None, derandomize=True)
def test_zigzag_is_a_bijection_that_keeps_small_numbers_small(number) -> None:
    assert unzigzag(zigzag(number)) == number
    assert zigzag(number) <= 2 * abs(number)
