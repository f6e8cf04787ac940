"""Outlines from CSV files; limits of size and time for all importers."""

import time

import pytest
from drawings import area, read, refused

from planner.part.importers.pieces import MAX_BYTES, time_limit
from runtime.shell.errors import InputError, UsageError

CSV = {
    "header in mm": ("x_mm,y_mm\n0,0\n30,0\n30,21\n0,21\n", None, 1.0),
    "header in inches": ("x (in),y (in)\n0,0\n30,0\n30,21\n0,21\n", None, 25.4),
    "plain header": ("x,y\n0,0\n30,0\n30,21\n0,21\n", "cm", 10.0),
    "closed": ("0 0\n30 0\n30 21\n0 21\n0 0\n", "mm", 1.0),
    "decimal commas": ("0,0;0,0\n30,0;0\n30;21,0\n0;21\n", "mm", 1.0),
    "comments, a byte order mark": ("\ufeff# a\r\n0,0\r\n\r\n30,0\r\n30,21\r\n0,21\r\n", "mm", 1.0),
}


@pytest.mark.parametrize(("text", "units", "scale"), CSV.values(), ids=CSV)
def test_read_csv_returns_the_outline_in_its_units(tmp_path, text, units, scale):
    path = tmp_path / "part.csv"
    path.write_text(text)
    result = read(path, units=units)
    assert area(result) == pytest.approx(630 * scale**2)
    assert result.symmetry == 2


BAD_CSV = {
    "no unit": (b"0,0\n30,0\n30,21\n", None, UsageError, "--units"),
    "three columns": (b"1,2,3\n", "mm", InputError, "line 1"),
    "two units": (b"x_mm,y_in\n0,0\n30,0\n30,21\n", None, InputError, "different units"),
    "y first": (b"y_mm,x_mm\n0,0\n30,0\n30,21\n", "mm", InputError, "line 1"),
    "not a number": (b"0,0\n1,nan\n", "mm", InputError, "line 2"),
    "digits of Python": (b"0,0\n3_0,0\n", "mm", InputError, "line 2"),
    "nothing": (b"", "mm", InputError, "no closed contour"),
    "back and forth": (b"0,0\n10,0\n" * 2000, "mm", InputError, "one line|no closed|itself"),
    "too long": (b"0,0\n" * 200_000, "mm", InputError, "200000 lines"),
}


@pytest.mark.parametrize(("data", "units", "error", "sentence"), BAD_CSV.values(), ids=BAD_CSV)
def test_read_bad_csv_is_refused_with_the_reason(tmp_path, data, units, error, sentence):
    path = tmp_path / "part.csv"
    path.write_bytes(data)
    refused(path, sentence, error, units=units)


def test_read_file_too_large_is_refused(tmp_path):
    path = tmp_path / "large.svg"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    refused(path, "larger than")


def test_time_limit_interrupts_slow_work_and_ends_with_its_block():
    with pytest.raises(InputError, match="longer than"), time_limit(0.05):
        time.sleep(20)
    with time_limit(0.2):
        pass
    time.sleep(0.3)  # the alarm is off
