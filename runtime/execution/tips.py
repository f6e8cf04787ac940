"""The arc of the finger tips: how far they advance as the jaws close, and where the arm levels them.

The finger links of a 2F gripper are parallelograms: with link length L and offset c, at an opening w the tips
stand sqrt(L^2 - (w/2 - c)^2) beyond the links' pivots (URDF models of the 2F-85).
"""

from dataclasses import dataclass
from math import inf, sqrt


def is_arc(link_mm: float, offset_mm: float) -> bool:
    """Whether links of this length can carry tips at this offset; false for NaN and infinity."""
    return abs(offset_mm) < link_mm < inf


@dataclass(frozen=True, slots=True)
class TipArc:
    """The arc on which a gripper's finger tips move as they close.

    Links of the gripper turn the fingers. Their length is that of the model; custom fingers change only the
    offset of the tips.
    """

    link_mm: float = 57.15  # L, the finger links' length
    offset_mm: float = 5.0  # c, how far inside the opening the pads stand from the link's end
    taught_mm: float = 85.0  # the opening at which the arm's tool frame was taught to the tips
    level_mm: float = 2.0  # tolerated height of the tips above their target between two stages

    def advance_mm(self, width_mm: float) -> float:
        """How much nearer to the table, mm, the tips are at a width than when the tool frame was taught."""
        return self._reach(width_mm) - self._reach(self.taught_mm)

    def most_mm(self, least_mm: float, widest_mm: float) -> float:
        """The largest `advance_mm` of all openings from `least_mm` to `widest_mm`.

        The tips advance farthest at an opening of twice the offset.
        """
        return self.advance_mm(min(max(2.0 * self.offset_mm, least_mm), widest_mm))

    def stages(self, widest_mm: float, least_mm: float) -> list[float]:
        """Openings to which jaws close one after the other on their way from `widest_mm` to `least_mm`.

        From one opening to the next the tips advance by no more than `level_mm`. The list excludes
        `widest_mm` and ends with `least_mm`.
        """
        top_mm = max(2.0 * self.offset_mm, least_mm)
        widths: list[float] = []
        reach = self._reach(widest_mm) + self.level_mm
        # At openings below twice the offset the tips only draw back, by a negligible amount.
        while widest_mm > top_mm and reach < self._reach(top_mm):
            widths.append(2.0 * (self.offset_mm + sqrt(self.link_mm**2 - reach**2)))
            reach += self.level_mm
        return [*widths, least_mm]

    def _reach(self, width_mm: float) -> float:
        return sqrt(self.link_mm**2 - (width_mm / 2.0 - self.offset_mm) ** 2)
