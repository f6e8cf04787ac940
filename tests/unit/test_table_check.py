"""A table against one gripper's calibration: what fits is passed, what does not is told in a sentence."""

import pytest
from grown_tables import grown_table
from sample_tables import GRIPPER, every_field_table, random_table, small_table

from runtime.table import Branch, Calibration, Node, Table, canonical, check

LINE = Calibration.linear(GRIPPER)


def changed(width_of) -> Calibration:
    """The default line with another width for some counts."""
    return Calibration(tuple(width_of(count, width) for count, width in enumerate(LINE.widths_um)))


def with_branches(*intervals: tuple[int, int, int]) -> Table:
    table = small_table()
    last = len(intervals) - 1
    branches = [
        Branch(low, expected, high, 10**6 if at == last else 0, ~at)
        for at, (low, expected, high) in enumerate(intervals)
    ]
    node = Node(table.nodes[0].squeeze, tuple(branches))
    return Table(
        table.tool,
        table.job_digest,
        table.gripper,
        table.goal,
        table.limits,
        (node,),
        tuple(table.leaves[at] for at in range(len(intervals))),
        table.predicted,
        None,
    )


@pytest.mark.parametrize(
    "table", [small_table(), every_field_table(), random_table(1, 40), grown_table(1, 100)]
)
def test_a_proved_table_fits_the_default_line(table: Table) -> None:
    assert check(canonical(table), LINE) == []


def test_a_small_error_of_the_line_fits() -> None:
    assert check(canonical(small_table()), changed(lambda count, width: width + 120)) == []


def test_jaws_that_do_not_open_far_enough_are_told() -> None:
    (problem,) = check(small_table(), changed(lambda count, width: min(width, 60_000)))
    assert problem.startswith("the table opens the jaws to 85.00 mm, but this calibration ends at 60.00 mm;")
    assert check(small_table(), changed(lambda count, width: min(width, 84_700))) == []


def test_a_flat_stretch_is_told_with_its_counts() -> None:
    at = LINE.count(30_000)
    flat = changed(lambda count, width: LINE.width_um(at) if at <= count <= at + 1 else width)
    (problem,) = check(small_table(), flat)
    assert problem.startswith(f"counts {at} and {at + 1} both mean 29.96 mm: the calibration is flat")


def test_a_branch_that_no_count_means_is_told() -> None:
    jump = changed(lambda count, width: width + 4_000 if width > 28_000 else width)
    problems = check(canonical(small_table()), jump)
    (told,) = (problem for problem in problems if "no count of this gripper" in problem)
    assert told.startswith("node 0, branch 1: no count of this gripper means 29.02 mm to 30.89 mm; calibrate")


def test_branches_that_the_calibration_cannot_separate_are_told() -> None:
    table = with_branches((20_000, 21_000, 23_000), (20_000, 21_500, 23_000))
    assert check(table, LINE) == []
    coarse = changed(lambda count, width: width if not 20_900 < width < 21_900 else LINE.width_um(173))
    problems = check(table, coarse)
    assert any("branch 0: count" in problem and "does not lead there" in problem for problem in problems)
