"""Properties of the hand of one cell: its calibration, the arc of its tips, and its way of gripping."""

from dataclasses import dataclass, replace

from runtime.errors import TableError
from runtime.execution.reading import CURRENT_MA
from runtime.execution.tips import TipArc
from runtime.table import CLEAR_MM, Calibration, Limits, Table, Timing


@dataclass(frozen=True, slots=True)
class Handling:
    """Properties of the hand that differ from cell to cell and not from table to table."""

    # measured map from nominal to true widths, None where there is none
    calibration: Calibration | None = None
    arc: TipArc | None = None  # the tips' arc; None where they move straight
    regulated: bool = False  # whether squeezes close gently and raise their force after contact
    # whether jaws close fast until just before the part; not where a person closes them
    approaches: bool = True
    # motor current at which a regulated squeeze raises its force no further, or None
    grip_current_ma: int | None = None
    # least and greatest motor currents a gripper at rest may report
    current_ma: tuple[int, int] = CURRENT_MA
    # distance from the hand's middle, along its y, at which the fingers meet
    middle_mm: float = 0.0

    def widths(self, table: Table) -> Calibration:
        """The map from nominal to true widths: the measured calibration, else the identity."""
        return self.calibration or Calibration(table.gripper.profile)

    def lifted(self, timing: Timing, calibration: Calibration) -> Timing:
        """Returns a timing in which the hand rises higher between two squeezes if the tips move on an arc.

        On an arc the tips may be lower than when the tool frame was taught. The hand rises higher by the
        largest such distance, but not above the retreat height.
        """
        if self.arc is None:
            return timing
        lower_mm = max(self.arc.most_mm(0.0, calibration.widest_um / 1000), 0.0)
        return replace(timing, regrasp_mm=min(timing.regrasp_mm + lower_mm, timing.retreat_mm))


def check_arc(arc: TipArc | None, limits: Limits, calibration: Calibration) -> None:
    """Checks that the tips' arc fits between a table's heights.

    Raises:
        TableError: the arc does not fit, or was taught with jaws that were not fully open.
    """
    if arc is None:
        return
    widest_mm = calibration.widest_um / 1000
    if arc.taught_mm < widest_mm - CLEAR_MM or widest_mm / 2 - arc.offset_mm >= arc.link_mm:
        raise TableError(
            f"the tips' arc was taught at {arc.taught_mm:g} mm and the jaws open to {widest_mm:g} mm; "
            "teach the tool frame with the jaws fully open, and check link and offset"
        )
    top_mm = limits.squeeze_height_um / 1000 + max(arc.most_mm(0.0, widest_mm), 0.0)
    retreat_mm = limits.retreat_height_um / 1000
    if top_mm >= retreat_mm:
        raise TableError(
            f"closing the jaws takes the arm up to {top_mm:.1f} mm, the retreat height is {retreat_mm:g} mm; "
            "raise cell.retreat_height_mm and recompile"
        )
