"""Charts: every mark within its box, every word apart from the next, every text escaped."""

import math
import re
from itertools import pairwise

import pytest
from html_pages import Page

from runtime.pages.charts import APART, MOST_POINTS, Band, Line, histogram, thinned, trend


def numbers(text):
    points = re.findall(r'points="([^"]*)"', text)
    return [float(value) for line in points for value in re.split(r"[ ,]", line)]


def test_thinned_line_keeps_its_extremes():
    values = [0.0] * 5000
    values[1234] = -7.0
    kept = thinned(values)
    assert len(kept) <= MOST_POINTS
    assert (1234, -7.0) in kept
    assert thinned([1.0, 2.0]) == [(0, 1.0), (1, 2.0)]


@pytest.mark.parametrize("values", [[0.0], [1.0, -2.0, 9.0], [math.sin(k) for k in range(3000)]])
def test_trend_stays_within_its_box_and_shows_its_limits(values):
    text = trend("a < b", [Line("x", values), Line("<y>", values[:1])], (-3.0, 3.0), "part")
    assert Page(text).open == []
    assert all(0.0 <= number <= 100.0 for number in numbers(text))
    assert text.count('class="limit" points') == 2
    assert "a &lt; b" in text
    assert "&lt;y&gt;" in text


def test_histogram_keeps_the_names_of_its_bands_apart():
    bands = [Band(k, k + 1.0, str(k)) for k in range(40)]
    text = histogram("widths", [(3.5, 9), (80.0, 1)], bands, (0.0, 85.0), "mm")
    assert Page(text).open == []
    left = [float(at) for at in re.findall(r"left:([\d.]+)%", text)]
    assert len(left) > 3
    assert all(right - at >= APART - 0.11 for at, right in pairwise(left))
    assert all(0.0 <= number <= 100.0 for number in numbers(text))
