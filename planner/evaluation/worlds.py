"""Worlds by name: `module:factory`, where `factory(job, seed)` returns something that squeezes parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import UsageError
from planner.job.model import Job
from planner.world import ContactWorlds, World, Worlds
from runtime.shell.worlds import DEFAULT_WORLD, WorldError, find_factory, make_world

SEED_COPY = 0x434F5059


@dataclass(frozen=True, slots=True, eq=False)
class NamedWorlds(Worlds):
    """Copies of a world by name: the factory is called for every chunk, each time with another seed.

    Attributes:
        name: "module:factory".
        job: handed to the factory.
        seed: the chunks' seeds are drawn from it.
    """

    name: str
    job: Job
    seed: int

    def world(self, chunk: int) -> World:
        """The world of a chunk."""
        words = np.random.SeedSequence([self.seed, chunk, SEED_COPY]).generate_state(1)
        return load_world(self.name, self.job, int(words[0]))


def supply(name: str, job: Job, seed: int, copies: bool = False) -> World | Worlds:
    """What an evaluation squeezes in.

    The contact world comes in copies, one for each chunk of trials: it is cheap to make. A world from
    elsewhere is made once and runs all trials one after another, since nobody knows what it costs to make and
    whether two of them may run side by side; `copies` says that they may.

    Args:
        name: "module:factory".
        job: what the parts and the gripper in this world are like.
        seed: of the world.
        copies: whether a world from elsewhere may be made for every chunk.

    Raises:
        UsageError: as `load_world`.
    """
    if name == DEFAULT_WORLD:
        return ContactWorlds.of_job(job, seed)
    return NamedWorlds(name, job, seed) if copies else load_world(name, job, seed)


def load_world(name: str, job: Job, seed: int) -> World:
    """Makes the world of that name; modules in the current folder are found too.

    Args:
        name: "module:factory".
        job: handed to the factory.
        seed: handed to the factory.

    Raises:
        UsageError: there is no such module or factory, it fails, or what it returns cannot squeeze.
    """
    try:
        world: World = make_world(find_factory(name), job, seed)
    except WorldError as error:
        raise UsageError(f"--world {name}: {error}") from error
    return world
