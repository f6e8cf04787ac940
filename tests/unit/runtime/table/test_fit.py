"""A table against one gripper's calibration: what fits is passed, what does not is told in a sentence."""

import pytest
from sample_tables import GRIPPER, changed, every_field_table, random_table, small_table

from runtime.table import Calibration, misfits

LINE = Calibration(GRIPPER.profile)


@pytest.mark.parametrize(
    "table", [small_table(), every_field_table(), random_table(1, 40), random_table(2, 100)]
)
def test_a_valid_table_fits_the_default_line(table):
    assert misfits(table, LINE) == []


def of(*points: tuple[int, int]) -> Calibration:
    return Calibration(GRIPPER.profile, points)


def test_jaws_that_do_not_open_far_enough_are_reported():
    problems = misfits(small_table(), of((0, 0), (60_000, 60_000)))
    assert problems[0].startswith("node 0 opens to 85.00 mm, this gripper to 60.00 mm; recompile")
    assert len(problems) == 2
    almost = of((0, 0), (84_850, 84_850))  # within the encoder's noise
    assert misfits(small_table(), almost) == []


def test_a_branch_that_no_reading_means_is_reported():
    result = misfits(small_table(), of((0, 0), (20_000, 0), (20_001, 85_000)))[0]
    assert result.startswith("node 0, branch 0: no reading of this gripper means 20.00..22.00 mm")


def test_an_outcome_that_reads_as_its_neighbour_is_reported():
    """Of the readings near 21 mm, this gripper's nearest one means 22.4 mm, the next branch's."""
    root = small_table().nodes[0]
    first = root.branches[0]._replace(low_um=18_000, expected_um=21_000, high_um=30_000)
    second = root.branches[1]._replace(low_um=18_000, expected_um=22_000, high_um=30_000)
    table = changed(small_table(), {"nodes.0.branches": (first, second)})
    coarse = of((0, 0), (5_000, 18_500), (20_000, 18_501), (20_001, 22_400), (60_000, 22_401))
    said = "node 0, branch 0: this gripper reads 21.00 mm as another"
    assert any(problem.startswith(said) for problem in misfits(table, coarse))
