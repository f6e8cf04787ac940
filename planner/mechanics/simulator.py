"""Simulates squeezes and pushes in batches on all cores; the number of cores does not change the results."""

import math
import os
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from planner import arguments
from planner.arrays import Array, BoolArray, IntArray, take
from planner.job.model import Job
from planner.job.schema import MOST_FRICTION
from planner.mechanics import surface as limit_surface
from planner.mechanics.clearance import Jaws, jaws_of
from planner.mechanics.push import (
    LOST,
    SLID,
    STUCK,
    Mechanics,
    Paths,
    PushEnds,
    Pushers,
    of_fingers,
    of_points,
    push_many,
)
from planner.mechanics.squeeze import (
    GRASPED,
    JAMMED,
    STATUS_NAMES,
    Each,
    Part,
    RollOut,
    squeeze_many,
)
from planner.mechanics.stepping import Body, scratch_of
from planner.mechanics.surface import Surface
from planner.mechanics.traits import FRESH, TRAITS, Traits, as_planned, shapes
from planner.part.outline import reach, simplified
from planner.work.scheduler import Threads

DEFAULT_STEP_MM, LEAST_STEP_MM = 0.4, 1e-3
MOST_JAWS_MM = 1e4
SIMPLIFY_MM = 0.005
"""Tolerance within which densely sampled outlines are simplified: finer than a step resolves."""
CHUNK = 512  # squeezes or pushes that a thread simulates in one call of a kernel
TRACE_ROWS = 2000  # most poses of a recorded squeeze
STUCK_MM, STUCK_DEG = 10.0, 5.0
"""Tolerated deviation of a part that sticks to its pusher from the motion of the pusher."""


class Parameters(NamedTuple):
    """Mechanical parameters of n roll-outs, such as the limit surface and the friction."""

    surfaces: Array  # (n, 3, 3) ellipsoids or (n, 6, 6), as from `surface.sample_each`
    mu: Array  # (n, 2) friction at the upper and the lower finger
    release: Array  # (n, 3) motion of a held part on opening [mm, mm, rad]
    share: Array  # (n,) upper finger's share of the closing
    deviation: Array  # (n, m) deviations of the outline, one for each shape of the simulator [mm]
    # (n,) mask of the ellipsoids among (6, 6) surfaces; None: all surfaces have the same form
    ellipsoid: BoolArray | None = None


class Pushed(NamedTuple):
    """Results of n pushes."""

    moved: Array  # (n, 3) displacement of the part in its frame at the start [mm, mm, rad]
    status: IntArray  # (n,) index into `planner.mechanics.push.PUSH_NAMES`
    given_up: IntArray  # (n,) 1 where the stepping failed and cut the push short


@dataclass(frozen=True, slots=True, eq=False)
class Simulator:
    """Simulates squeezes and pushes of one part by one gripper."""

    outline: Array  # (N, 2) the part, counter-clockwise, curves simplified to `SIMPLIFY_MM` [mm]
    surface: Surface  # the nominal limit surface
    jaws: Jaws
    friction: tuple[float, float]  # bounds of the coefficient between finger and part
    wishart_dof: int  # degrees of freedom of the limit surface's scatter (paper, IV: n_df)
    others: tuple[Surface, ...] = ()  # alternative limit surfaces, numbered 1, 2, ... in the traits
    # (m, N, 2) shapes of outline deviations: none, or `planner.mechanics.traits.shapes`
    shapes: Array = field(default_factory=lambda: np.zeros((0, 1, 2)))
    # std of x, y [mm] and angle [rad] on opening
    release: tuple[float, float, float] = (0.0, 0.0, 0.0)
    step_mm: float = DEFAULT_STEP_MM  # nominal closing step of each finger
    workers: int = 1  # threads that share the roll-outs

    def __post_init__(self) -> None:
        arguments.rows(self.outline, "outline", 2)
        arguments.count(len(self.outline), "number of vertices", 3)
        *lengths_mm, upper_share = self.jaws
        for length_mm in lengths_mm:
            arguments.number(length_mm, "a length of the jaws", 0.0, MOST_JAWS_MM)
        arguments.number(upper_share, "upper finger's share", 0.0, 1.0)
        arguments.row(self.friction, "friction", 2)
        arguments.row(self.release, "release", 3)
        arguments.number(self.step_mm, "step_mm", LEAST_STEP_MM, MOST_JAWS_MM)
        arguments.count(self.workers, "workers")

    @classmethod
    def of_job(cls, job: Job, workers: int | None = None, step_mm: float = DEFAULT_STEP_MM) -> Self:
        """Builds the simulator of a job; it uses all cores by default."""
        outline = np.array(simplified(job.part.outline_mm, SIMPLIFY_MM))
        return cls(
            outline=outline,
            surface=limit_surface.of_job(job),
            others=limit_surface.others_of(job),
            shapes=shapes(outline)[: None if job.part.tolerance_mm else 0],
            jaws=jaws_of(job.gripper),
            friction=(job.friction.finger_part_min, job.friction.finger_part_max),
            wishart_dof=job.pressure.wishart_dof,
            release=(
                job.release.shift_mm,
                job.release.shift_mm,
                math.radians(job.release.turn_deg),
            ),
            step_mm=step_mm,
            workers=(os.cpu_count() or 1)
            if workers is None
            else arguments.count(workers, "workers"),
        )

    def nominal(self, n: int, mu: float) -> Parameters:
        """Parameters of n roll-outs without scatter: the nominal limit surface and friction `mu`."""
        surface = limit_surface.nominal(self.surface)
        mu, n = arguments.number(mu, "mu", 0.0, MOST_FRICTION), arguments.count(n, "n", 0)
        return Parameters(
            surfaces=np.repeat(surface[None], n, axis=0),
            mu=np.full((n, 2), mu),
            release=np.zeros((n, 3)),
            share=np.full(n, self.jaws.upper_share),
            deviation=np.zeros((n, len(self.shapes))),
        )

    def sample(self, n: int, rng: np.random.Generator, traits: Traits | None = None) -> Parameters:
        """Draws parameters of n roll-outs: limit surfaces, friction, and motions of parts on release.

        Limit surfaces have a Wishart distribution, friction a uniform one, motions on release a normal one.
        The `traits` (n,) of the parts choose the nominal surface and the degrees of freedom of its scatter.
        They also state the finger share, the deviations of the outline and, unless `FRESH`, the friction. If
        `traits` is None, all parts are as planned.
        """
        parts_traits = as_planned(arguments.count(n, "n", 0)) if traits is None else traits
        arguments.same_length(poses=range(n), traits=parts_traits)
        checked_traits(parts_traits, 1 + len(self.others))
        dof = np.where(parts_traits["dof"] > 0, parts_traits["dof"], self.wishart_dof)
        surfaces, ellipsoid = limit_surface.sample_each(
            (self.surface, *self.others), parts_traits["surface"], dof, rng
        )
        drawn = rng.uniform(*self.friction, size=n)
        mu = np.where(parts_traits["friction"] == FRESH, drawn, parts_traits["friction"])
        release = rng.standard_normal((n, 3)) * np.array(self.release)
        share = np.clip(self.jaws.upper_share + parts_traits["share"], 0.0, 1.0)
        mus = np.repeat(mu[:, None], 2, axis=1)
        return Parameters(surfaces, mus, release, share, parts_traits["deviation"], ellipsoid)

    def squeeze(
        self, poses: Array, rng: np.random.Generator, traits: Traits | None = None
    ) -> RollOut:
        """Squeezes parts with latent parameters `traits` (n,) once, at poses (n, 3) in the hand frame.

        Draws the limit surface, friction and release of each squeeze; see `sample`.
        """
        poses = arguments.rows(poses, "poses", 3)
        return self.roll_out(poses, self.sample(len(poses), rng, traits))

    def trace(self, pose: Array, surface: Array, mu: float) -> tuple[Array, int]:
        """Squeezes a part at a pose (3,) in the hand frame, from open jaws, and records every step.

        Args:
            pose: (3,) pose of the part [mm, mm, rad].
            surface: (3, 3) ellipsoid or (6, 6) quartic, as from `surface.nominal`.
            mu: friction at both fingers.

        Returns:
            x, y, theta, width (k, 4) [mm, mm, rad, mm] along the path, and the index of the status in
            `STATUS_NAMES`.
        """
        q = arguments.row(pose, "pose", 3)
        surfaces, rows = checked_surfaces(np.asarray(surface)[None]), np.zeros((TRACE_ROWS, 4))
        result = _at_the_start(q[None])
        each = _each(self.nominal(1, mu)._replace(surfaces=surfaces))
        count = self._squeeze(each, result, rows)
        end = np.array([[*result.poses[0], result.width_mm[0]]])
        return np.concatenate([rows[:count], end]), int(result.status[0])

    def roll_out(self, poses: Array, parameters: Parameters) -> RollOut:
        """Squeezes a part once at each of `poses` (n, 3) in the hand frame [mm, mm, rad], from open jaws.

        Raises:
            ValueError: a shape does not fit, or a number is not finite.
        """
        poses = arguments.rows(poses, "poses", 3)
        check(parameters, len(poses), len(self.shapes))
        if parameters.ellipsoid is not None:
            forms = by_form(parameters)
            return in_order(
                [(rows, self.roll_out(poses[rows], chosen)) for rows, chosen in forms], len(poses)
            )
        result, each = _at_the_start(poses), _each(parameters)

        def run(start: int) -> None:
            rows = slice(start, start + CHUNK)
            self._squeeze(take(each, rows), take(result, rows), np.zeros((0, 4)))

        deque(Threads(self.workers).map(run, range(0, len(poses), CHUNK)), maxlen=0)
        held = (result.status == GRASPED) | (result.status == JAMMED)
        result.poses[held] += parameters.release[held]
        return result

    def _squeeze(self, each: Each, result: RollOut, trace: Array) -> int:
        """Squeezes the parts that lie at `result.poses`; returns the number of rows written to `trace`.

        `result` is filled in place.
        """
        columns = np.ascontiguousarray(self.outline.T)
        deviations = np.ascontiguousarray(self.shapes.transpose(0, 2, 1))
        part = Part(columns, deviations, self.surface.rho_mm)
        scratch = scratch_of(self.outline)
        return squeeze_many(part, self.jaws, self.step_mm, each, result, scratch, trace)

    def push(self, paths: Paths, parameters: Parameters, radius_mm: float = 0.0) -> Pushed:
        """Pushes the part once along each of n paths, given in the part's frame at the start.

        The pusher's points are the centres of round tips of `radius_mm`, which start clear of the part.
        Of the parameters only the limit surfaces and the friction matter.

        A part is "stuck" if it has moved and ends within `STUCK_MM` and `STUCK_DEG` of where a rigid motion
        with the pusher would take it; else "lost" if the pusher does not touch it at the end; else it "slid".
        """
        checked = Paths(
            arguments.rows(paths.points, "points", *np.shape(paths.points)[1:2], 2),
            arguments.rows(paths.centres, "centres", 2),
            arguments.rows(
                paths.angles, "angles", least=-arguments.MOST_TURN, most=arguments.MOST_TURN
            ),
            arguments.rows(
                paths.shifts, "shifts", 2, least=-arguments.LONGEST_MM, most=arguments.LONGEST_MM
            ),
        )
        arguments.same_length(**checked._asdict())
        n = len(checked.angles)
        check(parameters, n, len(self.shapes))
        moved, touching, given_up = self._pushed(
            np.zeros((n, 3)), of_points(checked, radius_mm), parameters
        )
        off = moved - commanded(paths)
        stuck = moved.any(axis=1) & (np.hypot(off[:, 0], off[:, 1]) < STUCK_MM)
        stuck &= np.abs(off[:, 2]) < math.radians(STUCK_DEG)
        return Pushed(moved, np.where(stuck, STUCK, np.where(touching == 1, SLID, LOST)), given_up)

    def push_by_hand(
        self,
        poses: Array,
        opening_mm: Array,
        way_mm: Array,
        rng: np.random.Generator,
        traits: Traits | None = None,
    ) -> Array:
        """Pushes parts (n, 3) with the ends of the fingers, each with random mechanics.

        If the fingers close unevenly, the middle between them lies beside the middle of the hand. Deviations
        of outlines are ignored, since they are tenths of a millimetre.

        Args:
            poses: (n, 3) poses of the parts in the hand's frame at the start, clear of the fingers [mm, mm,
                rad].
            opening_mm: (n,) opening of the jaws; 0: the fingers touch one another.
            way_mm: (n,) how far the hand goes along its x axis.
            rng: source of the random mechanics.
            traits: (n,) latent parameters of the parts; None: as planned.

        Returns:
            (n, 3) poses of the parts after the push, in the hand's frame at the start.

        Raises:
            ValueError: a shape does not fit, or a number is not finite or out of range.
        """
        start = arguments.rows(poses, "poses", 3)
        opening_mm = arguments.rows(opening_mm, "opening_mm", least=0.0, most=self.jaws.opening_mm)
        way_mm = arguments.rows(way_mm, "way_mm", least=0.0, most=arguments.LONGEST_MM)
        arguments.same_length(poses=start, opening_mm=opening_mm, way_mm=way_mm, traits=traits)
        parameters = self.sample(len(start), rng, traits)
        beside = beside_mm(parameters.share, self.jaws.opening_mm - opening_mm)
        pushers = of_fingers(
            opening_mm, np.asarray(way_mm, np.float64), self.jaws.length_mm, self.jaws.thickness_mm
        )
        # The kernel's fingers look down, at y = 0: a quarter turn makes the hand's x axis point down.
        x, y, theta = start.T
        turned = np.column_stack([y - beside, 0.5 * self.jaws.length_mm - x, theta - 0.5 * math.pi])
        across, back, angle = (self._pushed(turned, pushers, parameters).poses - turned).T
        return np.asarray(start + np.column_stack([-back, across, angle]))

    def _pushed(self, poses: Array, pushers: Pushers, parameters: Parameters) -> PushEnds:
        """Pushes parts at poses (n, 3) in the frame of the pusher; returns how each push ends."""
        n, final = len(poses), np.array(poses, dtype=np.float64, order="C", copy=True)
        result = PushEnds(final, np.zeros(n, np.int64), np.zeros(n, np.int64))
        columns, farthest = np.ascontiguousarray(self.outline.T), reach(self.outline)

        def run(start: int) -> None:
            chunk = np.arange(start, min(start + CHUNK, n))
            for some, drawn in by_form(take(parameters, chunk)):
                rows = chunk[some]
                ends, mechanics = take(result, rows), Mechanics(drawn.surfaces, drawn.mu)
                body = Body(columns, farthest, drawn.surfaces[0], self.surface.rho_mm)
                scratch = scratch_of(self.outline)
                push_many(body, self.step_mm, take(pushers, rows), mechanics, ends, scratch)
                for values, part in zip(result, ends, strict=True):
                    values[rows] = part

        deque(Threads(self.workers).map(run, range(0, n, CHUNK)), maxlen=0)
        return result


def _each(parameters: Parameters) -> Each:
    """Selects the parameters that the kernel of squeezes reads."""
    deviation = np.ascontiguousarray(parameters.deviation)
    return Each(parameters.surfaces, parameters.mu, parameters.share, deviation)


def _at_the_start(poses: Array) -> RollOut:
    """Prepares the results of squeezes of parts at `poses` (n, 3): these poses, and zeros."""
    n, start = len(poses), np.array(poses, dtype=np.float64, order="C", copy=True)
    return RollOut(start, np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.int64))


def check(parameters: Parameters, n: int, shapes: int) -> None:
    """Checks the parameters of n roll-outs of outlines with `shapes` deviations each.

    Raises:
        ValueError: a shape does not fit, or a number is not finite or out of range.
    """
    checked_surfaces(parameters.surfaces)
    arguments.rows(parameters.mu, "mu", 2, least=0.0, most=MOST_FRICTION)
    arguments.rows(parameters.release, "release", 3)
    arguments.rows(parameters.share, "share", least=0.0, most=1.0)
    if shapes:
        arguments.rows(parameters.deviation, "deviation", shapes)
    arguments.same_length(poses=range(n), **parameters._asdict())


def checked_traits(traits: Traits, surfaces: int) -> None:
    """Checks traits (n,) of parts for a simulator that has `surfaces` limit surfaces.

    Raises:
        ValueError: the argument is not an array of traits, or a number is not finite or out of range.
    """
    if np.shape(traits)[1:] or getattr(traits, "dtype", None) != TRAITS:
        raise ValueError("traits are not an array (n,) of traits; pass a changed as_planned(n)")
    arguments.indices(traits["surface"], "surface of the traits", surfaces)
    for name in ("friction", "share", "encoder_mm", "gain", "across_mm"):
        arguments.rows(traits[name], f"{name} of the traits")
    arguments.rows(traits["deviation"], "deviation of the traits", traits["deviation"].shape[1])


def checked_surfaces(surfaces: Array) -> Array:
    """Checks limit surfaces (n, 3, 3) or (n, 6, 6), and returns them.

    Raises:
        ValueError: the shape is wrong, or a number is not finite.
    """
    size = 6 if np.shape(surfaces)[1:] == (6, 6) else 3
    return arguments.rows(
        surfaces, "surfaces", size, size, least=-np.finfo(float).max, most=np.finfo(float).max
    )


def beside_mm(share: Array | float, closed_mm: Array | float) -> Array:
    """Offset along y of the fingers' middle from the hand's, in jaws closed by `closed_mm` [mm].

    The offset is 0 where the upper finger's `share` of the closing is a half. Arguments are numbers or arrays
    (n,).
    """
    return np.asarray((0.5 - share) * closed_mm)


def by_form(parameters: Parameters) -> Iterator[tuple[IntArray, Parameters]]:
    """Splits parameters into ellipsoids and quartics, since kernels handle one form at a time.

    Yields:
        The rows of each form, and their parameters.
    """
    ellipsoid = parameters.ellipsoid
    if ellipsoid is None:
        yield np.arange(len(parameters.surfaces)), parameters
        return
    bare = parameters._replace(ellipsoid=None)
    for rows, size in ((np.flatnonzero(ellipsoid), 3), (np.flatnonzero(~ellipsoid), 6)):
        chosen = take(bare, rows)
        yield rows, chosen._replace(surfaces=np.ascontiguousarray(chosen.surfaces[:, :size, :size]))


def in_order(pieces: Sequence[tuple[slice | IntArray, RollOut]], n: int) -> RollOut:
    """Merges the roll-outs of several sets of rows into one roll-out of n parts, in the order of the rows."""
    first = pieces[0][1]
    whole = RollOut(*(np.empty((n, *column.shape[1:]), column.dtype) for column in first))
    for rows, piece in pieces:
        for column, values in zip(whole, piece, strict=True):
            column[rows] = values
    return whole


def commanded(paths: Paths) -> Array:
    """Poses (n, 3) that a part would have after each path if it moved rigidly with the pusher [mm, mm, rad].

    Poses and paths are in the part's frame at the start.
    """
    c, s = np.cos(paths.angles) - 1.0, np.sin(paths.angles)
    x, y = paths.centres[:, 0], paths.centres[:, 1]
    dx, dy = paths.shifts[:, 0] - c * x + s * y, paths.shifts[:, 1] - s * x - c * y
    return np.column_stack([dx, dy, paths.angles])


__all__ = ["DEFAULT_STEP_MM", "STATUS_NAMES", "Parameters", "RollOut", "Simulator"]
