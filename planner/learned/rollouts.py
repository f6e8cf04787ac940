"""Roll-outs: the squeezes that the learned models are made from (paper V, VII).

They start all over the region about the hand (`planner.learned.region`), each with its own limit surface and
friction. Each ring is rolled out in blocks of `BLOCK` starts. A block depends on nothing but the squeeze
itself and its place, which name it in the store and seed its random stream; more roll-outs, or a larger
region, are therefore more blocks beside the ones that are there. Uncertainty, actions, goal and seed of a job
play no part in it.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, IntArray
from planner.errors import ClusterError
from planner.learned.region import farthest, ring_counts, stands_on, starts, within_reach
from planner.learned.slopes import few, slopes_of
from planner.learned.store import Store
from planner.mechanics import surface as limit_surface
from planner.mechanics.quartic import QuarticSurface
from planner.mechanics.simulator import Parameters, Simulator
from planner.mechanics.touch import TOUCHES, meet
from planner.progress import Report, silent
from planner.scheduler import Scheduler, Threads

COLLIDES = -1
DEFAULT_COUNT = 100_000
PAPER_COUNT = 9_000
"""Roll-outs for a model in the paper (VII)."""
BLOCK = 1024
"""Starts that are rolled out, sent and stored together: a few hundredths of a second."""
FORMAT = b"roll-outs 1"

Rows: TypeAlias = NDArray[np.void]
ROW = np.dtype(
    [("index", "<u2"), ("status", "i1"), ("initial", "<f8", 3), ("final", "<f8", 3), ("width_mm", "<f8")]
)
"""One roll-out of a block, in the store and on the way between machines."""
SLOPE = np.dtype([("index", "<u2"), ("initial", "<f8", 3), ("slope", "<f4", (4, 3))])
"""Its slope, kept apart: it costs four more roll-outs."""
Work: TypeAlias = Callable[[Simulator, bytes, "Block"], bytes]


class RollOuts(NamedTuple):
    """Squeezes from all over the region, in the order of their rings.

    Attributes:
        initial: (n, 3) poses before, in the hand frame [mm, mm, rad].
        final: (n, 3) poses after.
        width_mm: (n,) opening at which the fingers stopped.
        status: (n,) index into `planner.mechanics.simulator.STATUS_NAMES`; or `COLLIDES` where an open finger
            would stand on the part: final is then initial, and width_mm the opening.
    """

    initial: Array
    final: Array
    width_mm: Array
    status: IntArray


class Block(NamedTuple):
    """The place of `BLOCK` starts: ring `ring`, starts `BLOCK * number` and on."""

    ring: int
    number: int


def roll_outs(
    simulator: Simulator,
    radius_mm: float,
    count: int | None = None,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
    report: Report | None = None,
) -> RollOuts:
    """Roll-outs over a disc of part centres about the hand, at any angle.

    The result depends on the simulator, the radius and the count alone. A larger region, at the same number
    of roll-outs per area, contains the smaller one's; more roll-outs contain, ring by ring, the fewer.

    Args:
        simulator: the squeeze; its number of workers does not matter.
        radius_mm: of the disc; `planner.learned.region.region_radius` has a job's.
        count: starts spread over the disc, `DEFAULT_COUNT` if None. Those beyond the fingers' reach are left
            out, since nothing happens there, and chance decides how many of the last ring lie in the disc.
        store: where blocks are kept; nowhere if None.
        scheduler: who rolls out; the threads of this machine if None.
        report: told about progress in blocks.

    Raises:
        ValueError: radius or count are not above 0.
        ClusterError: the cluster was lost, or runs another version of this program.
    """
    table = _table(roll_block, ROW, simulator, radius_mm, count, store, scheduler, report)
    return RollOuts(
        np.ascontiguousarray(table["initial"]),
        np.ascontiguousarray(table["final"]),
        np.ascontiguousarray(table["width_mm"]),
        table["status"].astype(np.int64),
    )


def slopes(
    simulator: Simulator,
    radius_mm: float,
    count: int | None = None,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
    report: Report | None = None,
) -> Array:
    """Slopes of the roll-outs that `roll_outs` gives for the same arguments, which see.

    Returns:
        (n, 4, 3) change of final x, y, theta and of width_mm with initial x, y and theta
        (`planner.learned.slopes`); zero where no finger touches the part, or an open one stands on it.
    """
    table = _table(slope_block, SLOPE, simulator, radius_mm, count, store, scheduler, report)
    return np.ascontiguousarray(table["slope"], dtype=np.float64)


def _table(
    work: Work, row: np.dtype[np.void], simulator: Simulator, radius_mm: float, count: int | None,
    store: Store | None, scheduler: Scheduler | None, report: Report | None,
) -> Rows:  # fmt: skip
    """The rows of the region, one block's after the other."""
    count = DEFAULT_COUNT if count is None else count
    if not (0.0 < radius_mm < math.inf and count > 0):
        raise ValueError(f"radius_mm = {radius_mm} and count = {count} must be above 0")
    wanted = ring_counts(radius_mm, count)
    rings = min(len(wanted), len(ring_counts(farthest(simulator.outline, simulator.jaws), 1)))
    blocks = [Block(ring, k) for ring in range(rings) for k in range(-(-wanted[ring] // BLOCK))]
    rows = _finished(work, row, simulator, blocks, store, scheduler or Threads(), report or silent)
    kept = [
        part[: np.searchsorted(part["index"], wanted[ring] - number * BLOCK)]
        for (ring, number), part in zip(blocks, rows, strict=True)
    ]
    table = np.concatenate([np.empty(0, row), *kept])
    inside = np.hypot(table["initial"][:, 0], table["initial"][:, 1]) <= radius_mm
    return np.asarray(table[inside])


def _finished(
    work: Work, row: np.dtype[np.void], simulator: Simulator, blocks: list[Block], store: Store | None,
    scheduler: Scheduler, report: Report,
) -> list[Rows]:  # fmt: skip
    """The rows of every block, from the store or rolled out and stored one by one."""
    stage = "slopes" if work is slope_block else "roll-outs"
    alone = replace(simulator, workers=1)
    content, version = content_of(simulator), code_version()
    names = [_name(content, version, block, stage) for block in blocks]
    found = {block: store.get(name) for block, name in zip(blocks, names, strict=True)} if store else {}
    missing = [block for block in blocks if found.get(block) is None]
    report(stage, len(blocks) - len(missing), len(blocks))
    task = functools.partial(work, alone, version)
    for k, data in enumerate(scheduler.map(task, missing)):
        found[missing[k]] = data
        if store:
            store.put(_name(content, version, missing[k], stage), data)
        report(stage, len(blocks) - len(missing) + k + 1, len(blocks))
    if store and missing:
        store.trim()
    return [np.frombuffer(found[block] or b"", row) for block in blocks]


def roll_block(simulator: Simulator, version: bytes, block: Block) -> bytes:
    """Rolls out one block, wherever it runs.

    Args:
        simulator: the squeeze, with one worker.
        version: what `code_version` says where the block was asked for.
        block: its place.

    Returns:
        An array of `ROW`: the starts within the fingers' reach, in the order they were drawn.

    Raises:
        ClusterError: this is another version of the program.
    """
    reached, initial, parameters = _drawn(simulator, version, block)
    hits = stands_on(simulator.outline, simulator.jaws, initial)
    rolled = simulator.roll_out(initial, parameters)
    rows = np.empty(len(initial), ROW)
    rows["index"] = reached
    rows["status"] = np.where(hits, COLLIDES, rolled.status)
    rows["initial"] = initial
    rows["final"] = np.where(hits[:, None], initial, rolled.poses)
    rows["width_mm"] = rolled.width_mm
    return rows.tobytes()


def slope_block(simulator: Simulator, version: bytes, block: Block) -> bytes:
    """Finds the slopes of one block, wherever it runs; arguments and errors as of `roll_block`.

    Returns:
        An array of `SLOPE` in the same order.
    """
    reached, initial, parameters = _drawn(simulator, version, block)
    touched = np.flatnonzero(meet(simulator.outline, simulator.jaws, initial) == TOUCHES)
    rows = np.zeros(len(initial), SLOPE)
    rows["index"], rows["initial"] = reached, initial
    rows["slope"][touched] = slopes_of(simulator, initial[touched], few(parameters, touched))
    return rows.tobytes()


def _drawn(simulator: Simulator, version: bytes, block: Block) -> tuple[IntArray, Array, Parameters]:
    """The starts of a block within the fingers' reach: their numbers, poses and mechanics."""
    if version != code_version():
        raise ClusterError(
            "a worker of the cluster runs another version of squeezetree, numpy or numba, and would roll out "
            "something else; install the same on all machines"
        )
    rng = np.random.default_rng(int.from_bytes(_seed(content_of(simulator), block)))
    initial = starts(block.ring, BLOCK, rng)
    reached = np.flatnonzero(within_reach(simulator.outline, simulator.jaws, initial))
    return reached, initial[reached], simulator.sample(len(reached), rng)


def content_of(simulator: Simulator) -> bytes:
    """Digest of everything that a squeeze depends on: the part, its limit surface, the gripper, the step."""
    digest = hashlib.sha256(FORMAT)
    surface = simulator.surface
    arrays = [simulator.outline, limit_surface.nominal(surface), simulator.jaws]
    if isinstance(surface, QuarticSurface):
        arrays.append(surface.certificate)
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array, "<f8").tobytes())
    numbers = [
        surface.rho_mm, *simulator.friction, simulator.wishart_dof, *simulator.release,
        simulator.step_mm,
    ]  # fmt: skip
    digest.update(np.array(numbers, "<f8").tobytes())
    return digest.digest()


@functools.cache
def code_version() -> bytes:
    """Digest of the code that squeezes, and of what it runs on: other code makes other entries."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(f"numpy {np.__version__} numba {numba.__version__}".encode())
    own = [package / "learned" / name for name in ("rollouts.py", "region.py", "slopes.py")]
    for source in sorted([*(package / "mechanics").glob("*.py"), package / "kernel.py", *own]):
        digest.update(source.read_bytes())
    return digest.digest()


def _seed(content: bytes, block: Block) -> bytes:
    """Seed of a block's random stream; the version of the code is no part of it."""
    return hashlib.sha256(content + b"%d %d" % block).digest()


def _name(content: bytes, version: bytes, block: Block, stage: str) -> str:
    return hashlib.sha256(version + _seed(content, block) + stage.encode()).hexdigest()
