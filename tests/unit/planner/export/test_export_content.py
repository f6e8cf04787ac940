"""An export agrees with the runtime's decisions.

Its test vectors agree with them, and so do its runs. A run is a range of widths with the same decision.
"""

from itertools import pairwise

import pytest
from exported import Oracle, wide_table
from sample_tables import every_field_table, random_table, small_table
from tree_tables import committed

from planner.export.write import FELT, NOT_FELT, maps_of, runs_of, vectors
from runtime.table import REJECT, decide

TABLES = {**committed(), "small": small_table(), "every field": every_field_table()}
TABLES |= {"forty": random_table(5, 40), "wide": wide_table()}


@pytest.mark.parametrize("name", TABLES)
def test_vectors_equal_the_answers_of_a_run_and_cover_all_ends(name):
    table, result = TABLES[name], list(vectors(TABLES[name]))
    oracle = Oracle(table)
    assert len({row[:3] for row in result}) == len(result)
    ends = {
        (node, width, run.object_flag)
        for node, decided in enumerate(maps_of(table))
        for run in runs_of(decided)
        for width in (run.first_um - 1, run.first_um, run.last_um, run.last_um + 1)
    }
    assert ends <= {row[:3] for row in result}
    assert [row[3:] for row in result] == [oracle.answer(*row[:3]) for row in result]


@pytest.mark.parametrize("name", TABLES)
def test_runs_of_decision_map_equal_it_without_overlap(name):
    for decided in maps_of(TABLES[name]):
        runs = runs_of(decided)
        for flag in (FELT, NOT_FELT):
            flagged = [run for run in runs if run.object_flag == flag]
            assert all(one.last_um < other.first_um for one, other in pairwise(flagged))
            for width in range(0, 90_000, 97):
                read = [run.branch for run in flagged if run.first_um <= width <= run.last_um]
                assert decide(decided, width, flag == FELT) == (read or [REJECT])[0]
