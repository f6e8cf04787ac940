"""The layout of a tree: nothing overlaps, parents are above their children, branches keep their order."""

from itertools import pairwise

import pytest
from sample_tables import random_table, small_table

from planner.report.tree import Layout, Sizes, Spot, tidy
from runtime.table import Table

SIZES = Sizes(panel=32.0, label=29.0, text=36.0, margin=6.0)
TABLES = [random_table(seed, nodes) for seed, nodes in enumerate((1, 2, 5, 15, 40, 120))]
TABLES.append(small_table())


@pytest.fixture(params=TABLES, ids=lambda table: f"{len(table.nodes)}-nodes")
def table(request: pytest.FixtureRequest) -> Table:
    return request.param


def children(table: Table, layout: Layout, index: int) -> list[Spot]:
    targets = [branch.target for branch in table.nodes[index].branches]
    return [layout.spots[target] for target in targets]


def test_tidy_panels_of_a_row_keep_their_distance(table: Table) -> None:
    layout = tidy(table, SIZES)
    assert len(layout.spots) == len(table.nodes) + len(table.leaves)
    for depth in range(layout.rows):
        row = sorted(spot.x for spot in layout.spots.values() if spot.depth == depth)
        assert row
        least = 2 * SIZES.panel + SIZES.margin - 1e-9
        assert all(right - left >= least for left, right in pairwise(row))


def test_tidy_parents_stand_over_the_middle_of_their_children(table: Table) -> None:
    layout = tidy(table, SIZES)
    for index in range(len(table.nodes)):
        spot = layout.spots[index]
        below = children(table, layout, index)
        assert {child.depth for child in below} == {spot.depth + 1}
        assert [child.x for child in below] == sorted(child.x for child in below)
        assert spot.x == pytest.approx(0.5 * (below[0].x + below[-1].x))
