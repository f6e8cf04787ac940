"""Tables of several parts: their validation, and the goal under the symmetry of each part."""

import math
from dataclasses import replace

import pytest
from sample_tables import HAND, OTHER, changed, small_table
from sample_tables import several_table as table

from runtime.table import TableError, dumps, meets


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hypotheses": (HAND,)}, "number of hypotheses is 1"),
        ({"hypotheses": (HAND, HAND)}, "two hypotheses have one name"),
        ({"hypotheses": (HAND, OTHER._replace(symmetry=0))}, "hypothesis 1: symmetry is 0"),
        ({"hypotheses": (HAND, OTHER._replace(share_ppm=-1))}, "hypothesis 1: share_ppm is -1"),
        ({"hypotheses": (OTHER, HAND)}, "hypothesis 0 has another rho or symmetry"),
        ({"leaves.0.hypothesis": 2}, "hypothesis is 2"),
    ],
)
def test_dumps_invalid_hypotheses_are_refused(changes, message):
    with pytest.raises(TableError, match=message):
        dumps(changed(table(), changes))


def test_dumps_identity_goal_of_single_part_is_refused():
    for change in ({"goal.kind": "identity"}, {"goal.identify": False}):
        with pytest.raises(TableError, match="but there is only one"):
            dumps(changed(small_table(), change))
    with pytest.raises(TableError, match=r"leaf 2: hypothesis is 1, allowed is 0\.\.0"):
        dumps(changed(small_table(), {"leaves.2.hypothesis": 1}))


def test_meets_applies_symmetry_of_part():
    parts = table()
    one, two, _ = parts.leaves
    there, turned = (0.0, 0.5, 0.0), (0.0, 0.5, math.pi)
    assert meets(parts.goal_of(0), one, turned, 0)
    assert not meets(parts.goal_of(1), one, there, 1)
    loose = changed(parts, {"goal.identify": False})
    assert meets(loose.goal_of(1), one, there, 1)
    assert not meets(loose.goal_of(1), one, turned, 1)
    assert (parts.name_of(one), parts.name_of(two)) == ("left hand", "right hand")
    assert small_table().name_of(one) is None


def test_meets_identity_goal_ignores_pose():
    parts = table()
    goal = replace(parts.goal_of(0), kind="identity")
    assert meets(goal, parts.leaves[0], (90.0, 0.0, 1.0), 0)
    assert not meets(goal, parts.leaves[0], (0.0, 0.5, 0.0), 1)
