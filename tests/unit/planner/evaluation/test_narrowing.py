"""Which counts a narrowed table accepts, and how much two outlines differ in width."""

import numpy as np
import pytest

from planner.evaluation.narrowing import _kept, _worth
from planner.evaluation.strangers import widths_differ_mm
from runtime.table import REJECT


def test_counts_are_kept_where_they_pay_most():
    rng = np.random.default_rng(3)
    for _ in range(20):
        gain = rng.random(256) * (rng.random(256) < 0.2) - 0.2  # no two intervals pay the same
        sums = {(a, b): gain[a : b + 1].sum() for a in range(256) for b in range(a, 256)}
        assert _worth(gain) == max(sums, key=sums.__getitem__)


def test_a_branch_goes_where_strangers_cost_more_than_its_parts_are_worth():
    meant, seen = np.full((1, 256), REJECT), np.zeros((1, 256), np.int64)
    meant[0, 50:60], meant[0, 80:90], seen[0, 53:55], seen[0, 84:87] = 0, 1, 10, 10
    price = np.full((1, 256), 0.1)
    price[0, 54], price[0, 84:87] = 11.0, 11.0
    assert np.flatnonzero(_kept(meant, seen, price, 0) != REJECT).tolist() == [53]


@pytest.mark.parametrize(("readings", "beyond"), [(1, 3), (29, 3), (31, 2), (299, 2), (301, 1), (3001, 0)])
def test_branches_of_few_readings_reach_further_beyond_them(readings, beyond):
    meant, seen = np.full((1, 256), REJECT), np.zeros((1, 256), np.int64)
    meant[0, 50:100], meant[0, 120:] = 1, 0  # of which the latter was never read
    seen[0, 60], seen[0, 99] = readings, 0
    (kept,) = _kept(meant, seen, np.full((1, 256), 1e-6), 3)
    assert np.flatnonzero(kept == 1).tolist() == list(range(60 - beyond, 61 + beyond))
    assert not (kept == 0).any()


def test_widths_differ_the_same_however_parts_are_turned():
    rng = np.random.default_rng(7)
    plate, longer = (0.5 * np.array(s) * [[1, 1], [-1, 1], [-1, -1], [1, -1]] for s in ((40, 20), (46, 20)))
    assert widths_differ_mm(plate, plate) == 0.0
    for angle in rng.uniform(0.0, np.pi, 5):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        assert widths_differ_mm(plate @ turn, plate) < 0.2
        assert widths_differ_mm(plate @ turn, longer) == pytest.approx(6.0, abs=0.2)
