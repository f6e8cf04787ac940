"""`tools/soak` for tests: with the small table, in the world of the rehearsal."""

import importlib
import sys

from programs import REHEARSAL, ROOT
from sample_tables import small_table

from drivers.sim.physics.scene import Setting, table_geometry
from runtime.devices import rehearsal
from runtime.execution.executor import RunOptions
from runtime.table import Table

SCRIPT = ROOT / "tools" / "soak"

sys.path.insert(0, str(SCRIPT.parent))
soak_run = importlib.import_module("soak_run")


def small_setting(table: Table | None = None) -> Setting:
    """The setting of the rehearsal for a table; default: the small one."""
    table = table or small_table()
    return Setting(table, table_geometry(table), REHEARSAL[1], rehearsal.make)


HANDLED = (RunOptions(),)


def small_soak(parts=1, *, faults=False, handled=HANDLED, table: Table | None = None):
    """A soak test with `parts` parts in each run."""
    return soak_run.Soak(small_setting(table), table or small_table(), faults, parts, handled)
