"""Shares in percent add up as printed, and only exact shares are printed as 0 or 100 %."""

import numpy as np
import pytest

from planner.evaluation.shares import rounded


@pytest.mark.parametrize(
    "counts",
    [
        (19989, 11, 0, 0, 0),
        (19988, 13, 6, 0, 0),
        (3999, 1, 0, 0, 0),
        (1, 1, 1, 0, 0),
        (19999, 0, 0, 1, 0),
        (0, 0, 4000, 0, 0),
        (3331, 3333, 3, 0, 3333),
        (20000, 0, 0, 0, 0),
        (6667, 6667, 6666, 0, 0),
    ],
)
def test_rounded_shares_add_up_to_100_percent(counts):
    shares = np.array(counts) / sum(counts)
    result = rounded(shares.tolist())
    assert sum(round(100 * share) for share in result) == 100 * 100
    for share, exact in zip(result, shares, strict=True):
        assert abs(share - 100.0 * exact) <= 0.03
        assert (share == 0.0) == (exact == 0.0)
        assert (share == 100.0) == (exact == 1.0)
