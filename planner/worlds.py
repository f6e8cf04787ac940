"""Worlds by name: `module:factory`, where `factory(job, seed)` returns something that squeezes parts."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from planner.errors import UsageError
from planner.evaluate import World
from planner.job import Job

DEFAULT_WORLD = "planner.world:make"


def load_world(name: str, job: Job, seed: int) -> World:
    """Makes the world of that name; modules in the current folder are found too.

    Args:
        name: "module:factory".
        job: handed to the factory.
        seed: handed to the factory.

    Raises:
        UsageError: there is no such module or factory, or what it returns cannot squeeze.
    """
    module_name, _, factory_name = name.partition(":")
    if not module_name or not factory_name:
        raise UsageError(f"--world {name}: write it as module:factory, such as {DEFAULT_WORLD}")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise UsageError(f"--world {name}: module {module_name} cannot be imported: {error}") from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise UsageError(f"--world {name}: module {module_name} has no factory {factory_name}")
    world = factory(job, seed)
    if not callable(getattr(world, "squeeze", None)):
        raise UsageError(f"--world {name}: what the factory returns has no method squeeze(pose_hand)")
    return world  # type: ignore[no-any-return]
