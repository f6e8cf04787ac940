"""The tree of a plan as data."""

import numpy as np
import pytest
from hand_grown import grown

from planner.search.tree import breadth_first, pruned


def test_pruned_branch_is_left_out_and_the_tree_is_unchanged():
    root = grown()
    before = len(breadth_first(root))
    kept = pruned(root, [[1], [0, 1]])
    assert len(breadth_first(root)) == before
    assert len(kept.children) == 1
    assert kept.squeeze.clusters.mean == pytest.approx(root.squeeze.clusters.mean[[1]])
    assert np.array_equal(kept.children[0].belief.poses, root.children[1].belief.poses)
    assert root.squeeze.clusters.low[0] not in kept.squeeze.clusters.low
