"""A table against one gripper's calibration: each misfit is reported in a sentence."""

import pytest
from sample_tables import GRIPPER, changed, every_field_table, random_table, small_table

from runtime.table import Calibration, misfits

LINE = Calibration(GRIPPER.profile)


@pytest.mark.parametrize(
    "table", [small_table(), every_field_table(), random_table(1, 40), random_table(2, 100)]
)
def test_misfits_of_valid_table_on_default_line_is_empty(table):
    assert misfits(table, LINE) == []


def of(*points: tuple[int, int]) -> Calibration:
    return Calibration(GRIPPER.profile, points)


def test_misfits_narrow_jaws_are_reported():
    problems = misfits(small_table(), of((0, 0), (60_000, 60_000)))
    assert problems[0].startswith("node 0 opens to 85.00 mm, this gripper to 60.00 mm; recompile")
    assert len(problems) == 2
    almost = of((0, 0), (84_850, 84_850))  # within the encoder's noise
    assert misfits(small_table(), almost) == []


def test_misfits_branch_without_reading_is_reported():
    result = misfits(small_table(), of((0, 0), (20_000, 0), (20_001, 85_000)))[0]
    assert result.startswith("node 0, branch 0: no reading of this gripper means 20.00..22.00 mm")


def test_misfits_width_read_as_neighbour_branch_is_reported():
    """This gripper's reading nearest to 21 mm means 22.4 mm, a width of the next branch."""
    root = small_table().nodes[0]
    first = root.branches[0]._replace(low_um=18_000, expected_um=21_000, high_um=30_000)
    second = root.branches[1]._replace(low_um=18_000, expected_um=22_000, high_um=30_000)
    table = changed(small_table(), {"nodes.0.branches": (first, second)})
    coarse = of((0, 0), (5_000, 18_500), (20_000, 18_501), (20_001, 22_400), (60_000, 22_401))
    said = "node 0, branch 0: this gripper reads 21.00 mm as another"
    assert any(problem.startswith(said) for problem in misfits(table, coarse))
