"""Squeezes by the thousand, rolled out on all cores; the number of workers does not change the result."""

from __future__ import annotations

import math
import os
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, IntArray
from planner.job.model import Job
from planner.mechanics import surface as limit_surface
from planner.mechanics.clearance import jaws_of
from planner.mechanics.squeeze import GRASPED, JAMMED, STATUS_NAMES, grip_of, squeeze, squeeze_many
from planner.mechanics.stepping import Body, Scratch, squeeze_workspace
from planner.mechanics.surface import Surface
from planner.part.outline import reach, simplified
from planner.work.scheduler import Threads

DEFAULT_STEP_MM = 0.4
SIMPLIFY_MM = 0.005
"""Densely sampled curves lose the vertices that lie this near to the rest: less than the step resolves."""
CHUNK = 256
TRACE_ROWS = 2000


class Parameters(NamedTuple):
    """The uncertain mechanics of n roll-outs."""

    surfaces: Array  # (n, 3, 3) ellipsoids or (n, 6, 6) quartics, as `planner.mechanics.surface` makes them
    mu: Array  # (n, 2) friction at the upper and the lower finger
    release: Array | None = None  # (n, 3) what a held part does on opening [mm, mm, rad]; None: nothing

    def with_friction(self, friction: Array) -> Self:
        """The same, with these coefficients (n,) at both fingers where they are not NaN."""
        return self._replace(mu=np.where(np.isnan(friction)[:, None], self.mu, friction[:, None]))


class RollOut(NamedTuple):
    """What n squeezes came to."""

    poses: Array  # (n, 3) final poses in the hand frame [mm, mm, rad]
    width_mm: Array  # (n,) opening at which the fingers stopped
    status: IntArray  # (n,) index into `STATUS_NAMES`
    given_up: IntArray  # (n,) 1 where the stepping failed and the squeeze was cut short there


@dataclass(frozen=True, slots=True, eq=False)
class Simulator:
    """The squeeze of one part by one gripper."""

    outline: Array  # (N, 2) the part, counter-clockwise, curves simplified to `SIMPLIFY_MM` [mm]
    surface: Surface  # the nominal limit surface
    jaws: Array  # (4,) opening, finger length, finger thickness [mm], the upper finger's share of the closing
    friction: tuple[float, float]  # bounds of the coefficient between finger and part
    wishart_dof: int  # degrees of freedom of the limit surface's scatter (paper, IV: n_df)
    release: tuple[float, float, float] = (0.0, 0.0, 0.0)  # std of x, y [mm] and angle [rad] on opening
    step_mm: float = DEFAULT_STEP_MM  # nominal closing step of each finger
    workers: int = 1  # threads that share the roll-outs

    @classmethod
    def of_job(cls, job: Job, workers: int | None = None, step_mm: float = DEFAULT_STEP_MM) -> Self:
        """The simulator of a job, on all cores unless told otherwise."""
        return cls(
            outline=np.array(simplified(job.part.outline_mm, SIMPLIFY_MM)),
            surface=limit_surface.of_job(job),
            jaws=jaws_of(job.gripper),
            friction=(job.friction.finger_part_min, job.friction.finger_part_max),
            wishart_dof=job.pressure.wishart_dof,
            release=(job.release.shift_mm, job.release.shift_mm, math.radians(job.release.turn_deg)),
            step_mm=step_mm,
            workers=workers or os.cpu_count() or 1,
        )

    def nominal(self, n: int, mu: float) -> Parameters:
        """Parameters without scatter: the nominal limit surface and one friction value, n times."""
        surface = limit_surface.nominal(self.surface)
        return Parameters(np.repeat(surface[None], n, axis=0), np.full((n, 2), mu))

    def sample(self, n: int, rng: np.random.Generator) -> Parameters:
        """Random parameters of n roll-outs: Wishart limit surface, uniform friction, normal release."""
        surfaces = limit_surface.sample(self.surface, self.wishart_dof, rng, n)
        mu = rng.uniform(*self.friction, size=n)
        release = rng.standard_normal((n, 3)) * np.array(self.release)
        return Parameters(surfaces, np.repeat(mu[:, None], 2, axis=1), release)

    def trace(self, pose: Array, surface: Array, mu: float) -> tuple[Array, int]:
        """One squeeze of a pose (3,), jaws open, step by step; `surface` is (3, 3) or (6, 6).

        Returns x, y, theta, width on the way (k, 4) [mm, mm, rad, mm], from the start to the end, and the
        status.
        """
        n, q, rows = len(self.outline), np.array(pose, dtype=np.float64), np.zeros((TRACE_ROWS, 4))
        body = Body(self.outline, reach(self.outline), surface, self.surface.rho_mm)
        grip = grip_of(np.full(2, mu), self.jaws, self.step_mm)
        indices = np.zeros(n, np.int64), np.zeros(n, np.int64)
        scratch = Scratch(np.zeros((n, 2)), *indices, squeeze_workspace())
        width, status, _, count = squeeze(body, grip, q, scratch, rows)
        end = np.array([[*q, width]])
        return np.concatenate([rows[:count], end]), int(status)

    def roll_out(self, poses: Array, parameters: Parameters) -> RollOut:
        """Squeezes each pose (n, 3) in the hand frame once, jaws open [mm, mm, rad]."""
        final = np.array(poses, dtype=np.float64, order="C", copy=True)
        n = len(final)
        width = np.zeros(n)
        status, given_up = np.zeros(n, np.int64), np.zeros(n, np.int64)

        def run(start: int) -> None:
            part = slice(start, start + CHUNK)
            squeeze_many(
                self.outline, parameters.surfaces[part], self.surface.rho_mm, parameters.mu[part], self.jaws,
                self.step_mm, final[part], width[part], status[part], given_up[part],
                squeeze_workspace(),
            )  # fmt: skip

        deque(Threads(self.workers).map(run, range(0, n, CHUNK)), maxlen=0)
        if parameters.release is not None:
            held = (status == GRASPED) | (status == JAMMED)
            final += np.where(held, 1.0, 0.0)[:, None] * parameters.release
        return RollOut(final, width, status, given_up)


__all__ = ["DEFAULT_STEP_MM", "STATUS_NAMES", "Parameters", "RollOut", "Simulator"]
