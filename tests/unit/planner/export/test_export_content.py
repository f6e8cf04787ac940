"""What an export says follows a reading is what a run of the default policy does, reading by reading."""

import pytest
from counting import COUNTS, by_count
from exported import Oracle, wide_table
from sample_tables import every_field_table, random_table, small_table
from tree_tables import committed

from planner.export.write import FELT, NOT_FELT, maps_of, runs_of, vectors
from runtime.table import REJECT, decide

TABLES = {
    **committed(),
    "small": small_table(),
    "every field": every_field_table(),
    "forty": random_table(5, 40),
    "wide": wide_table(),
}


@pytest.mark.parametrize("name", TABLES)
def test_every_vector_is_what_a_run_does(name):
    table, result = TABLES[name], list(vectors(TABLES[name]))
    oracle = Oracle(table)
    assert {row[:3] for row in result} == {
        (node, count, flag)
        for node in range(len(table.nodes))
        for count in range(COUNTS)
        for flag in (FELT, NOT_FELT)
    }
    assert len(result) == 2 * COUNTS * len(table.nodes)
    assert [row[3:] for row in result] == [oracle.answer(*row[:3]) for row in result]


@pytest.mark.parametrize("name", TABLES)
def test_runs_are_the_decision_map_and_do_not_overlap(name):
    for decided in maps_of(TABLES[name]):
        runs = runs_of(decided)
        for flag in (FELT, NOT_FELT):
            read = [REJECT] * COUNTS
            for run in runs:
                if run.object_flag == flag:
                    assert set(read[run.first : run.last + 1]) == {REJECT}
                    read[run.first : run.last + 1] = [run.branch] * (run.last + 1 - run.first)
            assert read == [decide(decided, count, flag == FELT) for count in range(COUNTS)]


def test_a_part_that_is_held_is_dragged_and_what_is_rejected_is_not():
    table = every_field_table()
    drag, at = table.nodes[0].release, table.nodes[0].squeeze.place
    assert drag != at
    meant = by_count(maps_of(table)[0])
    for row in vectors(table):
        node, count, flag = row[:3]
        if node == 0 and flag == FELT:
            assert row[5:] == (at if meant[count] == REJECT else drag)
