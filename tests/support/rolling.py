"""Work for processes that a test starts and kills: importing this module compiles what they need."""

from __future__ import annotations

from pathlib import Path

from problems import rectangle, simulator

from planner.learned.rollouts import RollOuts, roll_outs
from planner.learned.store import Store
from planner.work.scheduler import Threads

PART = simulator(rectangle())
RADIUS_MM, COUNT = 10.0, 12_000


def generate(folder: str | Path) -> RollOuts:
    """Roll-outs in a dozen blocks, kept in a folder."""
    return roll_outs(PART, RADIUS_MM, COUNT, Store(Path(folder)), Threads(2))


roll_outs(PART, 5.0, 1)
