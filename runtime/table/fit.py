"""Whether a table fits one gripper: every branch still read, by counts that still mean its widths."""

from runtime.table.lookup import REJECT, Calibration, decide, decision_map
from runtime.table.model import Table


def misfits(table: Table, calibration: Calibration) -> list[str]:
    """What keeps a proved table from being executed with a gripper's own count-to-width map.

    The jaws must open as far as the table asks, and every branch must be read at one count at least, and not
    as another branch at the count nearest to its expected width.

    Returns:
        One sentence a problem, with what to do; empty if there is none.
    """
    problems, widest_um = [], calibration.widths_um[0]
    for index, node in enumerate(table.nodes):
        if node.squeeze.opening_um > widest_um + table.gripper.encoder_noise_um:
            problems.append(
                f"node {index} opens to {node.squeeze.opening_um / 1000:.2f} mm, this gripper to "
                f"{widest_um / 1000:.2f} mm; recompile with its opening"
            )
        decided = decision_map(node, calibration)
        for number, branch in enumerate(node.branches):
            nearest = calibration.count(branch.expected_um)
            if number not in decided:
                width = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
                problems.append(
                    f"node {index}, branch {number}: no count of this gripper means {width}; "
                    "calibrate it again, or recompile the table for its encoder"
                )
            elif decide(decided, nearest, branch.grip) not in (number, REJECT):
                problems.append(
                    f"node {index}, branch {number}: this gripper reads {branch.expected_um / 1000:.2f} mm "
                    "as another branch; recompile the table for its encoder"
                )
    return problems
