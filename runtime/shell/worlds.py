"""Finds worlds (simulations of squeezes) by their names.

A name has the form `module:factory`; `factory(subject, seed)` returns the world.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

DEFAULT_WORLD = "planner.world:make"
Factory = Callable[[Any, int], Any]


class WorldError(Exception):
    """A world cannot be found or made; the message says why."""


def find_factory(name: str) -> Factory:
    """Imports the factory of a world.

    Args:
        name: the world's name, `module:factory`; the module may be in the current folder.

    Raises:
        WorldError: the name is invalid, or the module or factory does not exist.
    """
    module_name, _, attribute = name.partition(":")
    if not (module_name and attribute.isidentifier()):
        raise WorldError(f"write it as module:factory, such as {DEFAULT_WORLD}")
    try:
        # an installed module has priority over one in the current folder
        if find_spec(module_name.partition(".")[0]) is None:
            sys.path.append(str(Path.cwd()))
        factory = getattr(import_module(module_name), attribute, None)
    except Exception as error:  # importing runs foreign code
        raise WorldError(f"module {module_name} cannot be imported: {error}") from error
    if not callable(factory):
        raise WorldError(f"module {module_name} has no function {attribute}")
    checked: Factory = factory
    return checked


def make_world(factory: Factory, subject: object, seed: int) -> Any:
    """Makes a world by its factory.

    Args:
        factory: the factory.
        subject: the job to simulate; for a rehearsal, the table.
        seed: seed of the random numbers.

    Raises:
        WorldError: the factory fails, or its result has no method `squeeze`.
    """
    try:
        world = factory(subject, seed)
    except Exception as error:
        kind = type(error).__name__
        raise WorldError(f"the factory called with job and seed: {kind}: {error}") from error
    if not callable(getattr(world, "squeeze", None)):
        raise WorldError("what the factory returns has no method squeeze(pose_hand)")
    return world
