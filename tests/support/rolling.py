"""Work for processes that a test starts and kills: importing this module compiles what they need."""

from __future__ import annotations

import os
import time
from pathlib import Path

from problems import rectangle, simulator

from planner.errors import ValueRangeError
from planner.learned.rollouts import RollOuts, roll_outs
from planner.learned.store import Store
from planner.work.scheduler import Threads

PART = simulator(rectangle())
RADIUS_MM, COUNT = 10.0, 12_000


def generate(folder: str | Path) -> RollOuts:
    """Roll-outs in a dozen blocks, kept in a folder."""
    return roll_outs(PART, RADIUS_MM, COUNT, Store(Path(folder)), Threads(2))


def logged(log: str, seconds: float, item: int) -> int:
    """The item's square; the process that works it out leaves a line in a file, before and after."""
    with Path(log).open("a") as file:
        file.write(f"{item} begun by {os.getpid()}\n")
    time.sleep(seconds)
    with Path(log).open("a") as file:
        file.write(f"{item} done by {os.getpid()}\n")
    return item * item


def refused(item: int) -> int:
    """Fails as a job does."""
    raise ValueRangeError(f"is no number, unlike {item}", section="goal", key="distance_mm")


roll_outs(PART, 5.0, 1)
