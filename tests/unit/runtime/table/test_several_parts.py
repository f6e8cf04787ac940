"""Tables of several parts: format 4, its proof, and the goal under each part's own symmetry."""

import math
from dataclasses import replace

import msgpack
import pytest
from sample_tables import HAND, OTHER, every_field_table, small_table
from sample_tables import several_table as table

from runtime.table import TableError, dumps, loads, meets


def frame(data: bytes) -> list[object]:
    """The parts of a file."""
    return list(msgpack.unpackb(data))


def test_it_comes_back_from_its_bytes() -> None:
    for one in (table(), replace(table(), goal=replace(table().goal, identify=False))):
        assert loads(dumps(one)) == one
    assert frame(dumps(table()))[1] == 4


def test_tables_of_one_part_keep_their_format() -> None:
    for one in (small_table(), every_field_table()):
        assert frame(dumps(one))[1] == 3


def test_its_payload_is_that_of_format_3_and_more() -> None:
    plain = replace(
        table(),
        hypotheses=(),
        leaves=tuple(leaf._replace(hypothesis=0, other_hypotheses=()) for leaf in table().leaves),
    )
    few, many = (msgpack.unpackb(frame(dumps(one))[3]) for one in (plain, table()))
    assert many[: len(few)] == few
    assert many[len(few) :] == [
        1,
        ["left hand", "right hand"],
        [400_000, 600_000],
        [10_571, 9_000],
        [2, 1],
        [0, 1, 1],
        [0],
    ]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hypotheses": (HAND,)}, "number of hypotheses is 1"),
        ({"hypotheses": (HAND, HAND)}, "two hypotheses have one name"),
        ({"hypotheses": (HAND, OTHER._replace(symmetry=0))}, "hypothesis 1: symmetry is 0"),
        ({"hypotheses": (HAND, OTHER._replace(share_ppm=-1))}, "hypothesis 1: share_ppm is -1"),
        ({"hypotheses": (OTHER, HAND)}, "are not the first hypothesis'"),
        (
            {"leaves": (table().leaves[0]._replace(hypothesis=2), *table().leaves[1:])},
            "hypothesis is 2",
        ),
    ],
)
def test_what_must_not_be_executed_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(TableError, match=message):
        dumps(replace(table(), **changes))


def test_one_part_is_not_asked_for() -> None:
    with pytest.raises(TableError, match="of which there is one"):
        dumps(replace(small_table(), goal=replace(small_table().goal, kind="identity")))


def test_a_leaf_is_right_about_its_own_part_under_that_parts_symmetry() -> None:
    parts = table()
    one, two, _ = parts.leaves
    there, turned = (0.0, 0.5, 0.0), (0.0, 0.5, math.pi)
    assert meets(parts.goal_of(0), one, turned, 0)
    assert not meets(parts.goal_of(1), one, there, 1)
    loose = replace(parts, goal=replace(parts.goal, identify=False))
    assert meets(loose.goal_of(1), one, there, 1)
    assert not meets(loose.goal_of(1), one, turned, 1)
    assert (parts.name_of(one), parts.name_of(two)) == ("left hand", "right hand")
    assert small_table().name_of(one) is None


def test_a_right_name_is_all_that_an_identity_asks_for() -> None:
    parts = table()
    goal = replace(parts.goal_of(0), kind="identity")
    assert meets(goal, parts.leaves[0], (90.0, 0.0, 1.0), 0)
    assert not meets(goal, parts.leaves[0], (0.0, 0.5, 0.0), 1)
