"""Whether a table fits a gripper: every branch still read, by counts that still mean its widths."""

from runtime.errors import CalibrationError
from runtime.table import HELD_UM, REJECT, Calibration, Table, decide, decisions


def check(table: Table, calibration: Calibration) -> None:
    """Check that a table can be executed with a gripper's own count-to-width map.

    Raises:
        CalibrationError: a node opens wider than the gripper does, or a branch has no count or not the one of
            its expected width.
    """
    widest_um = calibration.widths_um[0]
    for index, node in enumerate(table.nodes):
        if node.squeeze.opening_um > widest_um + table.gripper.encoder_noise_um:
            raise CalibrationError(
                f"node {index} opens to {node.squeeze.opening_um / 1000:.2f} mm, this gripper to "
                f"{widest_um / 1000:.2f} mm; recompile with its opening"
            )
        decided = decisions(node, calibration)
        for number, branch in enumerate(node.branches):
            width = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
            if number not in decided:
                raise CalibrationError(
                    f"node {index}, branch {number}: no count of this gripper means {width}; "
                    "calibrate it again, or recompile the table for its encoder"
                )
            nearest = calibration.count(branch.expected_um)
            if decide(decided, nearest, branch.expected_um >= HELD_UM) not in (number, REJECT):
                raise CalibrationError(
                    f"node {index}, branch {number}: this gripper reads {branch.expected_um / 1000:.2f} mm "
                    "as another branch; recompile the table for its encoder"
                )
