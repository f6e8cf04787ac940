"""Worlds: simulations that squeeze parts. The planner's own world is the stochastic contact world.

`make` is the default world factory of `plan-evaluate --world` and `grasp-cell --world`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np

from planner import arguments
from planner.arrays import Array, IntArray
from planner.belief.doubts import stated
from planner.belief.transition import read_as
from planner.job.model import Job
from planner.mechanics.clearance import Jaws, least_clearance
from planner.mechanics.simulator import (
    DEFAULT_STEP_MM,
    STATUS_NAMES,
    RollOut,
    Simulator,
    beside_mm,
)
from planner.mechanics.traits import Traits, as_planned, by_hypothesis, ordinary
from runtime.shell.errors import UsageError
from runtime.shell.worlds import DEFAULT_WORLD, WorldError, find_factory, make_world

Pose = tuple[float, float, float]
SEED_WORLD = 0x57524C44
SEED_COPY = 0x434F5059


class World(Protocol):
    """Interface of worlds: `squeeze(pose_hand) -> (final_pose_hand, width_mm, status)`.

    Optional methods are `squeeze_many(poses (n, 3))` and `collides(pose_hand, opening_mm)`. A world needs
    `squeeze_many(poses, traits (n,))` to squeeze parts whose latent parameters (traits) are not nominal. For
    tables that push, a world needs `push(pose_hand, opening_mm, way_mm) -> final_pose_hand` or
    `push_many(poses, opening_mm (n,), way_mm (n,), traits (n,))`. In a push the hand goes along its x axis.
    The poses before and after a push are in the frame that the hand has at the start.
    """

    def squeeze(self, pose_hand: Pose) -> tuple[Any, float, str]:
        """Closes the fingers on a part at a pose in the hand frame [mm, mm, rad].

        Returns:
            The final pose in the hand frame, the width [mm] and the status.
        """


class Worlds(ABC):
    """A supply of equal worlds, one for each chunk of trials, so that chunks can run in parallel.

    The result of a chunk depends only on its number. Instances are sent to other processes, so they must
    support pickling.
    """

    @abstractmethod
    def world(self, chunk: int) -> World:
        """Returns the world of a chunk, given its number; each chunk has its own random stream."""


class ContactWorld:
    """World that draws the mechanics of each squeeze (paper IV: Wishart limit surface, uniform friction)."""

    def __init__(self, job: Job, seed: int, workers: int | None = None) -> None:
        self._simulator = Simulator.of_job(job, workers)
        self._stated = stated(job, 1)
        self._rng = np.random.default_rng([seed, SEED_WORLD])

    @classmethod
    def of_simulator(cls, simulator: Simulator, seed: Sequence[int]) -> Self:
        """Makes a world that squeezes with an existing simulator and the random stream of `seed`."""
        world = cls.__new__(cls)
        world._simulator, world._stated = simulator, as_planned(1)
        world._rng = np.random.default_rng([*seed, SEED_WORLD])
        return world

    def squeeze(self, pose_hand: Pose) -> tuple[Pose, float, str]:
        """Closes open jaws on the part at a pose in the hand frame [mm, mm, rad].

        The cell is as the job states it: constant errors are at the middle of the intervals in its section
        [doubt].

        Returns:
            The final pose in the hand frame; the width [mm] with the constant errors of the encoder, but
            without noise and rounding; and the status.

        Raises:
            ValueError: the pose is not three finite numbers.
        """
        rolled = self.squeeze_many(self._felt(pose_hand), *self._unusual)
        x, y, theta = rolled.poses[0] + self._off
        read_mm = float(read_as(rolled.width_mm, self._stated)[0])
        width_mm = max(read_mm, 0.0) if rolled.width_mm[0] > 0.0 else 0.0
        return (float(x), float(y), float(theta)), width_mm, STATUS_NAMES[rolled.status[0]]

    @property
    def _off(self) -> Array:
        """The point of the hand frame where the fingers meet, as a pose (3,)."""
        return np.array([0.0, self._stated["across_mm"][0], 0.0])

    def _felt(self, pose_hand: Pose) -> Array:
        """Converts a pose in the hand frame to a row (1, 3) relative to the point where the fingers meet."""
        return arguments.row(pose_hand, "pose_hand", 3)[None] - self._off

    @property
    def _unusual(self) -> tuple[Traits, ...]:
        """Last arguments of `squeeze_many` and `push_many`: the traits that the job states; none if nominal.

        So a derived world may define these methods without traits, as long as the job states nominal ones.
        """
        return () if ordinary(self._stated).all() else (self._stated,)

    def squeeze_many(self, poses_hand: Array, traits: Traits | None = None) -> RollOut:
        """Squeezes parts at poses (n, 3) in the hand frame, each with its own mechanics.

        Raises:
            ValueError: see `squeeze`; or the numbers of traits and poses differ.
        """
        return self._simulator.squeeze(poses_hand, self._rng, traits)

    def push(self, pose_hand: Pose, opening_mm: float, way_mm: float) -> Pose:
        """Pushes the part: the hand, with its fingers `opening_mm` apart, goes `way_mm` along its x axis.

        Returns:
            The final pose in the frame that the hand had at the start [mm, mm, rad].

        Raises:
            ValueError: the pose is not three finite numbers, or the opening or the way is out of range.
        """
        way = self._felt(pose_hand), np.array([opening_mm]), np.array([way_mm])
        x, y, theta = self.push_many(*way, *self._unusual)[0] + self._off
        return float(x), float(y), float(theta)

    def push_many(
        self, poses_hand: Array, opening_mm: Array, way_mm: Array, traits: Traits | None = None
    ) -> Array:
        """Pushes parts at poses (n, 3), each with its own mechanics, and returns the final poses (n, 3).

        All poses are in the frame that the hand has at the start.

        Raises:
            ValueError: see `push`; or arguments differ in length.
        """
        return self._simulator.push_by_hand(poses_hand, opening_mm, way_mm, self._rng, traits)

    def collides(self, pose_hand: Pose, opening_mm: float) -> bool:
        """Whether fingers opened to `opening_mm` would stand on a part at a pose in the hand frame.

        Raises:
            ValueError: the pose is not three finite numbers, or the opening is out of range.
        """
        simulator = self._simulator
        opening_mm = arguments.number(opening_mm, "opening_mm", 0.0, simulator.jaws.opening_mm)
        x, y, theta = self._felt(pose_hand)[0].tolist()
        return stands_on(simulator.outline, simulator.jaws, (x, y, theta), opening_mm)


class Assorted:
    """The world of a job with several hypotheses: holds one world for each hypothesis."""

    def __init__(self, worlds: Sequence[World]) -> None:
        self.worlds = tuple(worlds)

    def squeeze(self, pose_hand: Pose) -> tuple[Any, float, str]:
        """Squeezes in the world of the first hypothesis."""
        return self.worlds[0].squeeze(pose_hand)


def world_of(job: Job, seed: int, make: Callable[[Job, int], World]) -> World:
    """Makes the world of a job with the factory `make`; each hypothesis gets a world with its own seed."""
    if not job.hypothesis:
        return make(job, seed)
    return Assorted([make(alone, seed + number) for number, alone in enumerate(job.alone)])


def by_world(world: World, traits: Traits) -> Iterator[tuple[World, IntArray, Traits]]:
    """Yields each world that has parts, with the rows (m,) and the traits (m,) of its parts.

    Each world of an `Assorted` has a single hypothesis, which is number 0 in the yielded traits. A world that
    is not `Assorted` has the parts of all hypotheses.

    Raises:
        ValueError: a part's hypothesis has no world.
    """
    if not isinstance(world, Assorted):
        yield world, np.arange(len(traits)), traits
        return
    for k, rows in by_hypothesis(traits):
        arguments.count(k, "hypothesis", 0, len(world.worlds) - 1)
        alone = traits[rows].copy()
        alone["hypothesis"] = 0
        yield world.worlds[k], np.arange(len(traits))[rows], alone


def is_contact(world: World) -> bool:
    """Whether a world is a contact world; of an `Assorted` the world of the first hypothesis decides."""
    return isinstance(world.worlds[0] if isinstance(world, Assorted) else world, ContactWorld)


def stands_on(outline: Array, jaws: Jaws, pose_hand: Pose, opening_mm: float) -> bool:
    """Whether fingers that come down open to `opening_mm` would stand on a part at a pose (hand frame)."""
    x, y, theta = pose_hand
    y -= float(beside_mm(jaws.upper_share, jaws.opening_mm - opening_mm))
    open_jaws, poses = jaws._replace(opening_mm=opening_mm), np.array([(x, y, theta)], np.float64)
    return least_clearance(outline, open_jaws, poses, np.zeros(3), margin_mm=0.0) < 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ContactWorlds(Worlds):
    """Supply of stochastic contact worlds of one job."""

    # Simulators, one for each hypothesis, with one worker, since chunks already share the cores.
    simulators: tuple[Simulator, ...]
    seed: int  # seed of all random numbers

    @classmethod
    def of_job(cls, job: Job, seed: int, step_mm: float = DEFAULT_STEP_MM) -> Self:
        """Makes the supply of worlds of a job; the fingers close in steps of `step_mm`."""
        return cls(tuple(Simulator.of_job(alone, 1, step_mm) for alone in job.alone), seed)

    def world(self, chunk: int) -> World:
        """Returns the world of a chunk, which has a random stream of its own."""
        stream = [self.seed, chunk]
        if len(self.simulators) == 1:
            return ContactWorld.of_simulator(self.simulators[0], stream)
        numbered = enumerate(self.simulators)
        return Assorted([ContactWorld.of_simulator(each, [*stream, k]) for k, each in numbered])


make = ContactWorld  # the world factory: `make(job, seed)`


@dataclass(frozen=True, slots=True, eq=False)
class NamedWorlds(Worlds):
    """Supply of worlds that a factory makes: one for each chunk of trials, each with its own seed."""

    name: str  # "module:factory"
    job: Job  # passed to the factory
    seed: int  # the chunks' seeds are drawn from it

    def world(self, chunk: int) -> World:
        """Makes the world of a chunk, given its number."""
        words = np.random.SeedSequence([self.seed, chunk, SEED_COPY]).generate_state(1)
        return load_world(self.name, self.job, int(words[0]))


def supply(name: str, job: Job, seed: int, copies: bool = False) -> World | Worlds:
    """Makes the world "module:factory" for an evaluation, or a supply of such worlds.

    The contact world gets a supply, with a world for each chunk of trials. Any other world is made once and
    runs all trials in sequence, unless `copies` allows several to run in parallel.

    Raises:
        UsageError: see `load_world`.
    """
    if name == DEFAULT_WORLD:
        return ContactWorlds.of_job(job, seed)
    return NamedWorlds(name, job, seed) if copies else load_world(name, job, seed)


def load_world(name: str, job: Job, seed: int) -> World:
    """Makes the world "module:factory" of a job; looks for the module in the current folder, too.

    Raises:
        UsageError: the module or factory does not exist or fails, or its result cannot squeeze.
    """
    try:
        factory = find_factory(name)
        return world_of(job, seed, lambda alone, world_seed: make_world(factory, alone, world_seed))
    except WorldError as error:
        raise UsageError(f"--world {name}: {error}") from error
