"""Model of observations: readings of the finger encoder, linear in the width, with noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, IntArray, take
from planner.job.model import Job

SIGMAS = 6.0
"""Least distance of two widths that are distinguished, in standard deviations; 0.3 % are mistaken."""
COARSE_MM = 0.4  # range of widths that the search may treat as one reading
MARGIN_MM = 1.0
"""Distance beyond the widths seen that a branch reaches, at most half a gap."""


@dataclass(frozen=True, slots=True)
class Encoder:
    """A linear encoder with noise. A reading is a number of steps of closing: 0 open, `steps` closed."""

    opening_mm: float  # width at reading 0
    steps: int  # number of steps from open to closed
    noise_mm: float  # standard deviation of a measured width before its rounding

    @property
    def mm_per_step(self) -> float:
        """Change of the width for one step of a reading [mm]."""
        return self.opening_mm / self.steps

    @property
    def grain_mm(self) -> float:
        """Scatter of the readings of one width: the resolution, or the noise where that is larger."""
        return max(self.mm_per_step, self.noise_mm)

    def read(self, width_mm: Array, rng: np.random.Generator) -> IntArray:
        """Noisy readings of true widths, clipped at both ends of travel."""
        noisy = width_mm + self.noise_mm * rng.standard_normal(np.shape(width_mm))
        readings = np.rint(self.steps - noisy / self.mm_per_step)
        return np.asarray(np.clip(readings, 0, self.steps), dtype=np.int64)

    def with_flag(self, readings: IntArray, width_mm: Array) -> IntArray:
        """Corrects readings (n,) by the object flag: a held part, however thin, never reads as empty."""
        held = np.minimum(readings, resolution_of(self).free - 1)
        return np.where(width_mm > 0.0, held, readings)

    def width_mm(self, readings: Array | IntArray) -> Array:
        """The width in the middle of a reading's interval; fractional readings are allowed."""
        return np.asarray((self.steps - np.asarray(readings, dtype=np.float64)) * self.mm_per_step)

    def width_um(self, readings: IntArray) -> IntArray:
        """Width at a reading, rounded to the micrometres that a driver reports and a table looks up."""
        opening_um = round(1e3 * self.opening_mm)
        closed = self.steps - np.asarray(readings, np.int64)
        return np.asarray((2 * opening_um * closed + self.steps) // (2 * self.steps))


def encoder_of(job: Job) -> Encoder:
    """The encoder of a job's gripper."""
    gripper = job.gripper
    return Encoder(gripper.opening_mm, gripper.profile.steps, gripper.noise_mm)


class Resolution(NamedTuple):
    """Limits for distinguishing readings, from the step and the noise of an encoder [steps]."""

    apart: float = 3.0  # least distance of two cluster means
    free: int = 225  # least reading of an empty hand
    margin: int = 3  # steps by which a branch extends beyond its readings
    grain: float = 1.0  # scatter of the readings of one width, at least a step
    coarsest: int = 1  # most steps that the search may treat as one reading


class Partition(NamedTuple):
    """Clusters of readings, in the order of rising width, that is, of falling readings."""

    mean: Array  # (k,) mean reading of each cluster
    low: IntArray  # (k,) least reading in it
    high: IntArray  # (k,) greatest reading in it
    size: IntArray  # (k,) how many readings it holds

    @classmethod
    def of(cls, readings: Sequence[IntArray]) -> Self:
        """Computes the mean, limits and size of each cluster from a non-empty array of its readings."""
        return cls(
            mean=np.array([each.mean() for each in readings]),
            low=np.array([each.min() for each in readings]),
            high=np.array([each.max() for each in readings]),
            size=np.array([len(each) for each in readings]),
        )

    def of_clusters(self, numbers: Sequence[int]) -> Self:
        """Returns the partition of the clusters with these numbers only, in this order."""
        return take(self, np.array(numbers, np.int64))


def resolution_of(encoder: Encoder) -> Resolution:
    """Returns the limits for distinguishing the readings of an encoder."""
    step_mm = encoder.mm_per_step
    noise = encoder.noise_mm / step_mm
    return Resolution(
        apart=max(SIGMAS * math.sqrt(noise**2 + 1.0 / 12.0), 3.0),
        free=encoder.steps - math.ceil(0.5 * SIGMAS * noise),
        margin=math.ceil(MARGIN_MM / step_mm),
        grain=encoder.grain_mm / step_mm,
        coarsest=max(1, int(COARSE_MM / step_mm)),
    )
