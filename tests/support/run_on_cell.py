"""Runs `grasp-runtime --port sim` on a cell that is already running.

The environment variable `CELL` has the addresses of the cell's devices, as a JSON object.
"""

import json
import os
import sys
from typing import Any

from runtime import cli
from runtime.commands import cell
from runtime.devices.cell_process import Endpoints


class RunningProcess:
    """Replaces the process of a new cell, which the run would start, by the running cell."""

    def __init__(self, *_: Any, **__: Any) -> None:
        endpoints = json.loads(os.environ["CELL"])
        self.endpoints = Endpoints(**{name: endpoints.get(name, "") for name in Endpoints._fields})

    def __enter__(self) -> "RunningProcess":
        return self

    def __exit__(self, *_: object) -> None:
        """Does nothing: the cell keeps running."""


if __name__ == "__main__":
    cell.CellProcess = RunningProcess  # type: ignore[assignment,misc]
    sys.exit(cli.main())
