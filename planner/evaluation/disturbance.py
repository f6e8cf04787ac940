"""Errors of a simulated cell besides its mechanics: an offset of the encoder, and errors of the arm."""

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.belief.doubts import hypotheses_of, traits_of
from planner.belief.transition import true_placements
from planner.job.model import Job
from planner.mechanics.traits import Traits


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Errors of a simulated cell's encoder and arm that the plan does not assume."""

    encoder_offset_mm: float = 0.0  # added to every width before it is read
    placement_mm: float = 0.0  # standard deviation of the hand's x and y, drawn for every squeeze
    placement_deg: float = 0.0  # standard deviation of the hand's angle
    bias_mm: tuple[float, float] = (0.0, 0.0)  # constant error of the hand's x and y in the world
    bias_deg: float = 0.0  # constant error of the hand's angle
    across_mm: float = 0.0  # constant error of the hand's place along the closing direction
    believed: bool = False  # whether latent parameters are drawn by the job's doubts, too

    @property
    def bias(self) -> Array:
        """Error (3,) of the arm's frame in the world [mm, mm, rad].

        All motions have this error, including the motion to a leaf's pose, since the table's poses are in the
        arm's frame.
        """
        return np.array([*self.bias_mm, math.radians(self.bias_deg)])

    def placed(self, placements: Array, traits: Traits, rng: np.random.Generator) -> Array:
        """True poses (n, 3) of the hand in the world if the arm is sent to `placements` [mm, mm, rad]."""
        turn = math.radians(self.placement_deg)
        spread = np.array([self.placement_mm, self.placement_mm, turn])
        return true_placements(placements + self.bias, traits, rng, spread)

    def traits(self, job: Job, n: int, rng: np.random.Generator, contact: bool = True) -> Traits:
        """Draws the latent parameters of n parts in this cell.

        Args:
            job: states the parts.
            n: number of parts.
            rng: draws the hypothesis of each part and its latent parameters.
            contact: whether the cell's world is a contact world. Any other world simulates errors of its own.
                So only the hypotheses are drawn for it, unless `believed` adds the job's doubts.
        """
        if not (contact or self.believed):
            traits = hypotheses_of(job, n, rng)
        else:
            traits = traits_of(job, n, rng, with_doubts=self.believed)
        traits["encoder_mm"] += self.encoder_offset_mm
        traits["across_mm"] += self.across_mm
        return traits


NONE = Disturbance()  # a cell as the plan believes it to be
WITH_DOUBTS = Disturbance(believed=True)  # a cell in which all doubts of the job apply
