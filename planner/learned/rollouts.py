"""Roll-outs: training squeezes for the learned model of the paper (paper V, VII).

The centre of the part starts in a disc about the hand, at any angle of the part. Each roll-out has its own
limit surface and friction. The disc consists of rings of equal density, rolled out in blocks of `BLOCK`
starts. The random stream of a block is seeded by the simulator, the ring and the number of the block in the
ring. So roll-outs stay the same when starts, or rings of the same density, are added. Actions, goal and seed
of a job have no effect.
"""

import hashlib
import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray, take
from planner.job.model import Job
from planner.mechanics import surface as limit_surface
from planner.mechanics.clearance import STANDS_ON, Jaws, classify_contact, jaws_of
from planner.mechanics.quartic import QuarticSurface
from planner.mechanics.simulator import Simulator
from planner.part.outline import reach
from planner.work.progress import Report, silent
from planner.work.scheduler import Threads

COLLIDES = -1  # Status of a roll-out in which an open finger would come down on the part
PAPER_COUNT = 9_000  # Number of roll-outs in the paper (VII)
BLOCK = 1024  # Number of starts of a block; rolling it out takes a few hundredths of a second
FORMAT = b"roll-outs 1"
RING_MM = 5.0  # Width of a ring
FACTOR = 3.0  # Radius of the region, in units of the radius of the job's uncertainty (paper, VII)


class RollOuts(NamedTuple):
    """Training squeezes, ordered by the ring in which they start, the innermost first."""

    initial: Array  # (n, 3) poses before, in the hand frame [mm, mm, rad]
    final: Array  # (n, 3) poses after
    width_mm: Array  # (n,) opening at which the fingers stopped
    status: IntArray  # (n,) index into `STATUS_NAMES`; or `COLLIDES`: final = initial, width_mm = opening


class Block(NamedTuple):
    """A block of consecutive starts in one ring, at most `BLOCK` of them.

    The block begins at start number `BLOCK * number` of the ring.
    """

    ring: int  # number of the ring, from the innermost on
    number: int  # number of the block in the ring
    starts: int  # starts of the ring from this block on


def roll_outs(
    simulator: Simulator, radius_mm: float, count: int, report: Report = silent
) -> RollOuts:
    """Rolls out training squeezes over a disc of part centres about the hand, at any angle.

    The result depends on the simulator, the radius and the count only. It may have fewer than `count`
    roll-outs, since starts beyond the fingers' reach are left out. It may also have more: starts are drawn in
    the whole last ring, and it is chance how many of them lie in the disc. Progress counts blocks.

    Raises:
        ValueError: radius or count is not above 0, or the radius is infinite.
    """
    if not (0.0 < radius_mm < math.inf and count > 0):
        raise ValueError(f"radius_mm = {radius_mm} and count = {count} must be above 0")
    wanted = ring_counts(radius_mm, count)
    rings = min(len(wanted), len(ring_counts(farthest(simulator.outline, simulator.jaws), 1)))
    blocks = [
        Block(ring, number, wanted[ring] - number * BLOCK)
        for ring in range(rings)
        for number in range(-(-wanted[ring] // BLOCK))
    ]
    run = partial(roll_block, replace(simulator, workers=1))
    pieces = [RollOuts(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0, np.int64))]
    report("roll-outs", 0, len(blocks))
    for done, piece in enumerate(Threads(simulator.workers).map(run, blocks), start=1):
        pieces.append(piece)
        report("roll-outs", done, len(blocks))
    whole = RollOuts(*(np.concatenate(columns) for columns in zip(*pieces, strict=True)))
    return take(whole, np.hypot(*whole.initial[:, :2].T) <= radius_mm)


def roll_block(simulator: Simulator, block: Block) -> RollOuts:
    """Rolls out those starts of one block that lie within the fingers' reach."""
    rng = np.random.default_rng(int.from_bytes(_seed(content_of(simulator), block)))
    drawn = starts(block.ring, BLOCK, rng)
    reached = np.flatnonzero(within_reach(simulator.outline, simulator.jaws, drawn))
    initial, parameters = drawn[reached], simulator.sample(len(reached), rng)
    hits = classify_contact(simulator.outline, simulator.jaws, initial) == STANDS_ON
    rolled = simulator.roll_out(initial, parameters)
    final = np.where(hits[:, None], initial, rolled.poses)
    status = np.where(hits, COLLIDES, rolled.status)
    return take(RollOuts(initial, final, rolled.width_mm, status), reached < block.starts)


def content_of(simulator: Simulator) -> bytes:
    """Digest of all inputs of a squeeze: part, limit surface, gripper, friction, scatter, release, step."""
    digest = hashlib.sha256(FORMAT)
    surface = simulator.surface
    arrays = [simulator.outline, limit_surface.nominal(surface), np.array(simulator.jaws)]
    if isinstance(surface, QuarticSurface):
        arrays.append(surface.certificate)
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array, "<f8").tobytes())
    scatter = [*simulator.friction, simulator.wishart_dof, *simulator.release]
    digest.update(np.array([surface.rho_mm, *scatter, simulator.step_mm], "<f8").tobytes())
    return digest.digest()


def _seed(content: bytes, block: Block) -> bytes:
    """Seed of the random stream of a block."""
    return hashlib.sha256(content + b"%d %d" % (block.ring, block.number)).digest()


def region_radius(job: Job) -> float:
    """Radius of the disc in which the roll-outs of a job start [mm].

    It is `FACTOR` times the radius of the job's uncertainty, but at least one ring, and at most as far as the
    fingers reach.
    """
    limit = farthest(job.part.outline_mm, jaws_of(job.gripper))
    return max(RING_MM, min(FACTOR * job.uncertainty.radius_mm, limit))


def farthest(outline: Array, jaws: Jaws) -> float:
    """Distance of part and hand beyond which no finger touches the part, at any angle of the part [mm].

    The distance is that between the part's centre and the hand's.
    """
    half_x, half_y = _swept(jaws)
    return math.hypot(half_x, half_y) + reach(outline)


def within_reach(outline: Array, jaws: Jaws, poses: Array) -> BoolArray:
    """Mask (n,) of `poses` (n, 3) at which the part's circumscribed circle meets the box of the fingers.

    The box contains the fingers during a whole squeeze. So the fingers touch no part at a pose outside the
    mask.
    """
    half_x, half_y = _swept(jaws)
    dx = np.maximum(np.abs(poses[:, 0]) - half_x, 0.0)
    dy = np.maximum(np.abs(poses[:, 1]) - half_y, 0.0)
    return np.asarray(np.hypot(dx, dy) <= reach(outline))


def ring_counts(radius_mm: float, count: int) -> list[int]:
    """The number of starts in each ring, the innermost first, so that about `count` starts lie in the disc.

    The last ring is filled as a whole, even if the disc ends within this ring.
    """
    density = count / (math.pi * radius_mm**2)
    rings = math.ceil(radius_mm / RING_MM)
    return [round(density * math.pi * RING_MM**2 * (2 * ring + 1)) for ring in range(rings)]


def starts(ring: int, n: int, rng: np.random.Generator) -> Array:
    """Draws poses (n, 3) with centres uniform in ring number `ring` and uniform angles [mm, mm, rad]."""
    radius = RING_MM * np.sqrt(rng.uniform(ring**2, (ring + 1) ** 2, n))
    bearing = rng.uniform(-math.pi, math.pi, n)
    angle = rng.uniform(-math.pi, math.pi, n)
    return np.column_stack([radius * np.cos(bearing), radius * np.sin(bearing), angle])


def _swept(jaws: Jaws) -> tuple[float, float]:
    """Half the extents in x and y of the box that contains the fingers during a whole squeeze [mm]."""
    return 0.5 * jaws.length_mm, 0.5 * jaws.opening_mm + jaws.thickness_mm
