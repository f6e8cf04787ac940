"""Percentiles of the times of parts, and the share within a takt."""

from collections import Counter
from random import Random

import pytest

from runtime.table.takt import figures, text


def test_figures_of_many_parts_equal_those_of_sorted_list():
    random = Random(3)
    seconds = [round(random.expovariate(0.2), 2) for _ in range(997)]
    result, rising = figures(Counter(seconds), 4.0), sorted(seconds)
    for percentile in (50, 95, 99):
        limit = result[f"seconds_p{percentile}"]
        assert sum(value <= limit for value in rising) >= percentile * len(rising) / 100
        assert sum(value < limit for value in rising) < percentile * len(rising) / 100
    assert result["seconds_max"] == rising[-1]
    assert result["seconds_mean"] == pytest.approx(sum(rising) / len(rising))
    assert result["takt_probability"] == sum(value <= 4.0 for value in rising) / len(rising)
    assert result["takt_s"] == 4.0
    assert not {"takt_probability", "takt_s"} & figures(Counter(seconds)).keys()


def test_text_states_share_and_takt():
    assert text(figures({1.5: 3, 2.5: 1}, 2.0)) == "75.00% done within 2 s"
