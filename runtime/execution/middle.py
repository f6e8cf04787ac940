"""The place where the fingers meet, measured on a fixed block, and its distance from the planned one."""

from math import hypot
from typing import NamedTuple, Self

from runtime.table import HELD_UM, Table, job_of

MOST_MM = 10.0  # fingers that meet farther off are a fault of the tool frame
EVEN = 0.5  # share of each finger in the closing, if both move equally far
SURE = 2.0  # half width of a remaining doubt, in standard deviations


class Middle(NamedTuple):
    """Measured place where the fingers meet; errors are standard deviations."""

    block_mm: float  # width of the block
    across_mm: float  # distance from the hand's middle at that width, along the hand's y
    across_error_mm: float
    share: float  # share of the closing of the finger at +y
    share_error: float

    @classmethod
    def parsed(cls, record: object) -> Self | None:
        """Parses the entry `middle` of a calibration file; None where the middle was not measured.

        Raises:
            TypeError, ValueError: the entry is invalid.
        """
        if record is None:
            return None
        if not isinstance(record, dict):
            raise TypeError("has a middle that is no JSON object")
        result = cls(**{name: float(value) for name, value in record.items()})
        if not abs(result.across_mm) <= MOST_MM:
            raise ValueError(f"has fingers that meet {result.across_mm:g} mm off the hand's middle")
        return result

    def at(self, width_mm: float) -> tuple[float, float]:
        """Distance from the hand's middle at which the fingers meet at a width, and its error [mm]."""
        further = width_mm - self.block_mm
        across = self.across_mm + (self.share - EVEN) * further
        return across, hypot(self.across_error_mm, self.share_error * further)


def off_mm(measured: Middle | None, table: Table) -> float:
    """Measured minus planned place where the fingers meet, mm, along the hand's y; 0 without a measurement.

    Both places are those for the narrowest held part (`narrowest_mm`). The planned place is the hand's
    middle, unless the job states that the fingers have uneven shares of the closing.
    """
    if measured is None:
        return 0.0
    width_mm = narrowest_mm(table)
    planned = (EVEN - _planned_share(table)) * (table.gripper.opening_um / 1000 - width_mm)
    return measured.at(width_mm)[0] - planned


def left(measured: Middle, table: Table) -> dict[str, list[float]]:
    """The uncertainty that a measurement leaves, as values for a job's section `[doubt]`.

    Returns:
        For each key the least and the greatest error. `middle_mm`: error of the measured place where the
        fingers meet. `finger_share`: error of the upper finger's share of the closing that the job states.
    """
    error_mm = SURE * measured.at(narrowest_mm(table))[1]
    more, spread = measured.share - _planned_share(table), SURE * measured.share_error
    return {
        "middle_mm": [-round(error_mm, 2), round(error_mm, 2)],
        "finger_share": [round(more - spread, 3), round(more + spread, 3)],
    }


def narrowest_mm(table: Table) -> float:
    """The least expected width, mm, of a held part at any branch of the table."""
    expected = [branch.expected_um for node in table.nodes for branch in node.branches]
    return min((width for width in expected if width >= HELD_UM), default=HELD_UM) / 1000


def _planned_share(table: Table) -> float:
    gripper = (job_of(table) or {}).get("gripper")
    share = gripper.get("upper_finger_share", EVEN) if isinstance(gripper, dict) else EVEN
    return float(share)
