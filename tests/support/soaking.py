"""`tools/soak` as tests run it: on the small table, in a rehearsal."""

import importlib
import sys
from pathlib import Path

from sample_tables import small_table

from drivers.sim.physics.scene import Setting, table_geometry
from runtime.devices import rehearsal
from runtime.execution.executor import RunOptions

SCRIPT = Path(__file__).parents[2] / "tools" / "soak"

sys.path.insert(0, str(SCRIPT.parent))
soak_run = importlib.import_module("soak_run")


def small_setting() -> Setting:
    """A rehearsal of the small table."""
    table = small_table()
    return Setting(table, table_geometry(table), "runtime.devices.rehearsal:make", rehearsal.make)


def small_soak(
    parts: int = 1, *, faults: bool = False, handled: tuple[RunOptions, ...] = (RunOptions(),)
) -> object:
    """Runs of that many parts."""
    return soak_run.Soak(small_setting(), small_table(), faults, parts, handled)
