"""The chart of readings: a likelihood ratio, silent on a healthy cell, quick when the cell changes."""

import json
from math import exp

import numpy as np
import pytest
from histories import LESS, drawn, expectation_document, history, table, watch

from runtime.shell.errors import InputError, UsageError
from runtime.spc import expectation
from runtime.spc.expectation import CLIP, ShiryaevRoberts, load
from runtime.spc.history import History

TABLE = table()
DIGEST = "0" * 64


@pytest.fixture(scope="module")
def output():
    return expectation_document(TABLE, DIGEST)


@pytest.fixture(scope="module")
def expected(output, tmp_path_factory):
    path = tmp_path_factory.mktemp("expected") / "expected.json"
    path.write_text(json.dumps(output))
    return load(path)


def test_expectation_shares_are_positive_and_sum_to_one(expected):
    for world in expected.shares:
        for node in world:
            assert len(node) == TABLE.gripper.bins
            assert sum(node) == pytest.approx(1.0)
            assert min(node) > 0.0


def test_expectation_mean_ratio_when_healthy_is_at_most_one(expected):
    planned, other = expected.shares
    for before, after in zip(planned, other, strict=True):
        ratios = [min(q / p, exp(CLIP)) for p, q in zip(before, after, strict=True)]
        assert sum(p * ratio for p, ratio in zip(before, ratios, strict=True)) <= 1.0 + 1e-9


def test_shiryaev_roberts_value_sums_ratio_products_over_starts(expected):
    parts, chart = drawn(TABLE, 40, np.random.default_rng(3)), ShiryaevRoberts(expected)
    gains = np.array([expected.gains(TABLE, part)[0] for part in parts])
    for part in parts:
        assert chart.add(TABLE, part) is None
    since = sum(exp(gains[start:].sum()) for start in range(len(parts)))
    assert chart.value == pytest.approx(since)


def test_shiryaev_roberts_false_alarm_rate_is_within_limit(expected, monkeypatch):
    monkeypatch.setattr(expectation, "LIMIT", 60.0)
    chart = ShiryaevRoberts(expected)
    parts = drawn(TABLE, 2000, np.random.default_rng(4))
    alarms = sum(chart.add(TABLE, part) is not None for part in parts)
    assert 0 < alarms <= 2000 / 60.0


def test_watch_fewer_jams_are_flagged_by_name_within_fifty_parts(expected):
    rng = np.random.default_rng(5)
    parts = history(TABLE, drawn(TABLE, 300, rng), drawn(TABLE, 50, rng, shares=LESS))
    result = watch(parts, expected)
    assert all(alarm.place >= 300 for alarm in result)
    assert any(alarm.chart == "readings" and "those of less" in alarm.sentence for alarm in result)


WORLD = {"name": "a", "readings": [{}]}


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "expectations"},
        {"version": 1},
        {"bins": 10**12},
        {"worlds": 3},
        {"worlds": [WORLD]},
        *({"worlds": [WORLD | {"readings": [row]}, WORLD]} for row in ({"300": 1}, {"3": -1})),
    ],
)
def test_load_malformed_file_is_refused(change, output, tmp_path):
    result = tmp_path / "changed.json"
    result.write_text(json.dumps(output | change))
    with pytest.raises(InputError, match="does not hold"):
        load(result)


def test_load_missing_file_or_not_json_is_refused(tmp_path):
    with pytest.raises(InputError, match="make it with plan-expect"):
        load(tmp_path / "none.json")
    (tmp_path / "text").write_text("{")
    with pytest.raises(InputError, match="is not JSON"):
        load(tmp_path / "text")


def test_watch_expectation_of_another_table_is_refused(expected, output, tmp_path):
    parts = tuple(drawn(TABLE, 2, np.random.default_rng(6)))
    assert watch(History(TABLE, parts, DIGEST), expected) == []
    with pytest.raises(UsageError, match="another table"):
        watch(History(TABLE, parts, "1" * 64), expected)
    (tmp_path / "e.json").write_text(json.dumps(output | {"bins": TABLE.gripper.bins + 1}))
    with pytest.raises(UsageError, match="another table"):
        watch(History(TABLE, parts, DIGEST), load(tmp_path / "e.json"))
