"""What goes wrong between the table and the world, besides the mechanics: the encoder's zero, the arm."""

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Errors of the cell that the plan was not told of."""

    encoder_offset_mm: float = 0.0  # added to every width before it is read
    placement_mm: float = 0.0  # standard deviation of the hand's x and y, drawn for every squeeze
    placement_deg: float = 0.0  # standard deviation of its angle
    bias_mm: tuple[float, float] = (0.0, 0.0)  # constant error of the hand's x and y in the world
    bias_deg: float = 0.0  # constant error of its angle
    across_mm: float = 0.0  # constant error of its place along the closing direction

    def placed(self, placements: Array, rng: np.random.Generator) -> Array:
        """Where the arm puts the hand that was told to go to (n, 3) [mm, mm, rad].

        As many numbers are drawn whatever the errors are, so that trials compare one by one.
        """
        spread = np.array([self.placement_mm, self.placement_mm, math.radians(self.placement_deg)])
        bias = np.array([*self.bias_mm, math.radians(self.bias_deg)])
        placed = placements + bias + spread * rng.standard_normal((len(placements), 3))
        closing = np.stack([-np.sin(placed[:, 2]), np.cos(placed[:, 2])], axis=1)
        placed[:, :2] += self.across_mm * closing
        return np.asarray(placed)


NONE = Disturbance()  # a cell as the plan believes it to be
