"""Does a table fit one gripper: its look-up once more, against the widths measured on that gripper."""

from runtime.table_lookup import COUNTS, Calibration, decide, decisions
from runtime.table_model import HELD_UM, Branch, Node, Table
from runtime.table_proof import unreadable


def check(table: Table, calibration: Calibration) -> list[str]:
    """What keeps a proved table from being executed with a calibrated gripper; moves nothing.

    The jaws must open as far as the table asks; the calibration must fall at every count between the widths
    that the table knows; every branch must be read at one count at least, and at the count nearest to its
    expected width.

    Args:
        table: the table, proved.
        calibration: the widths of this gripper's counts, never rising (`Calibration` refuses others).

    Returns:
        One sentence a problem, with what to do; empty if there is none.
    """
    problems = _range_problems(table, calibration)
    for index, node in enumerate(table.nodes):
        problems += [f"node {index}, {problem}" for problem in _node_problems(node, calibration)]
    return problems


def _range_problems(table: Table, calibration: Calibration) -> list[str]:
    problems, widths = [], calibration.widths_um
    opening, widest = max(node.squeeze.opening_um for node in table.nodes), widths[0]
    count_um = table.gripper.opening_um // (table.gripper.count_closed - table.gripper.count_open)
    if opening > widest + count_um:
        problems.append(
            f"the table opens the jaws to {_mm(opening)}, but this calibration ends at {_mm(widest)}; "
            "calibrate with the jaws fully open, or compile for this gripper"
        )
    branches = [branch for node in table.nodes for branch in node.branches]
    low, high = min(branch.low_um for branch in branches), max(branch.high_um for branch in branches)
    for count in range(1, COUNTS):
        width = widths[count]
        if width == widths[count - 1] and max(low, widths[-1]) < width < min(high, widest):
            problems.append(
                f"counts {count - 1} and {count} both mean {_mm(width)}: the calibration is flat where the "
                "table tells widths apart; calibrate with more gauge blocks"
            )
    return problems


def _node_problems(node: Node, calibration: Calibration) -> list[str]:
    problems, missing, decided = [], unreadable(node, calibration), decisions(node, calibration)
    for number, branch in enumerate(node.branches):
        count = calibration.count(branch.expected_um)
        if number in missing:
            problems.append(
                f"branch {number}: no count of this gripper means {_interval(branch)}; calibrate again, or "
                "compile for this gripper"
            )
        elif decide(decided, count, branch.expected_um >= HELD_UM) != number:
            problems.append(
                f"branch {number}: count {count} is the nearest to the {_mm(branch.expected_um)} expected in "
                f"{_interval(branch)}, but does not lead there; calibrate again, or compile for this gripper"
            )
    return problems


def _interval(branch: Branch) -> str:
    return f"{_mm(branch.low_um)} to {_mm(branch.high_um)}"


def _mm(width_um: int) -> str:
    return f"{width_um / 1000:.2f} mm"
