"""A block held fast on the table, in place of parts: fingers stop at it and cannot move it."""

from math import cos, sin

from drivers.planar import Pose2
from drivers.sim.physics.tabletop import TableTop


class Vice(TableTop):
    """The table with the setting's block on it; no part comes."""

    def squeeze(self, hand: Pose2) -> float | None:
        """The first finger that touches stops both: the width (mm, as the encoder sees it), or None."""
        self.squeezes += 1
        needed_mm = self._needed(hand)
        return (
            None if needed_mm is None else needed_mm + self._noise.gauss(0.0, self.geometry.encoder_noise_mm)
        )

    def gripped(self) -> None:
        """It stays where it is."""

    def placed(self, hand: Pose2, opening_mm: float) -> None:
        """Fingers that come down on it crash."""
        self.crashes += (self._needed(hand) or 0.0) > opening_mm

    def _needed(self, hand: Pose2) -> float | None:
        """How far fingers about the hand are apart as the first of them touches; None beside the block."""
        block = self._setting.block
        assert block is not None
        x, y = block.x_mm - hand[0], block.y_mm - hand[1]
        c, s = cos(hand[2]), sin(hand[2])
        wide_mm = block.width_mm * (abs(c) + abs(s))  # as it is turned to the fingers
        return wide_mm + 2.0 * abs(c * y - s * x) if abs(c * x + s * y) < wide_mm / 2.0 else None
