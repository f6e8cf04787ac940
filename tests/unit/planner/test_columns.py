"""Columns of numbers in CSV files."""

import numpy as np
import pytest

from planner import columns
from runtime.shell.errors import InputError


def test_read_columns_in_another_order_and_a_default(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("\ufeffy, x\r\n2,1\r\n4,3\r\n")
    table = columns.read(path, ("x", "y"), {"z": 7.0})
    assert {name: column.tolist() for name, column in table.items()} == {
        "x": [1.0, 3.0],
        "y": [2.0, 4.0],
        "z": [7.0, 7.0],
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x,y\n1,5,2,0\n", "line 2: has more fields than the header"),
        ("x,y,x\n1,2,3\n", "names a column twice"),
        ("x,y\n1\n", "line 2: None is not a finite number"),
        ("x,y\n1,inf\n", "line 2: 'inf' is not a finite number"),
    ],
)
def test_read_row_that_does_not_fit_its_header_is_refused(tmp_path, text, says):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        columns.read(path, ("x", "y"))


def test_write_then_read_gives_the_same_numbers(tmp_path):
    table = {"x": np.array([0.1, -2e-7]), "y": np.array([1e5, 3.0])}
    columns.write(tmp_path / "t.csv", table)
    again = columns.read(tmp_path / "t.csv", ("x", "y"))
    assert all(np.array_equal(again[name], table[name]) for name in table)
