"""The finger encoder: widths to counts and back (linear map of the gripper, devices' own scale)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, IntArray
from planner.job import Job

COUNTS = 256


@dataclass(frozen=True, slots=True)
class Encoder:
    """A linear encoder with noise.

    Attributes:
        opening_mm: width at `count_open`.
        count_open: reading with the jaws open.
        count_closed: reading with the jaws closed.
        noise_mm: standard deviation of a measured width.
    """

    opening_mm: float
    count_open: int
    count_closed: int
    noise_mm: float

    @property
    def mm_per_count(self) -> float:
        """Resolution."""
        return self.opening_mm / (self.count_closed - self.count_open)

    def read(self, width_mm: Array, rng: np.random.Generator) -> IntArray:
        """Noisy counts of true widths; both ends of travel are hard stops."""
        noisy = width_mm + self.noise_mm * rng.standard_normal(np.shape(width_mm))
        counts = np.rint(self.count_closed - noisy / self.mm_per_count)
        return np.asarray(np.clip(counts, self.count_open, self.count_closed), dtype=np.int64)

    def width_mm(self, counts: Array | IntArray) -> Array:
        """Width at a count, the middle of what reads so; fractions of a count allowed."""
        return np.asarray((self.count_closed - np.asarray(counts, dtype=np.float64)) * self.mm_per_count)


def encoder_of(job: Job) -> Encoder:
    """The encoder of a job's gripper."""
    gripper = job.gripper
    return Encoder(gripper.opening_mm, gripper.count_open, gripper.count_closed, gripper.encoder_noise_mm)
