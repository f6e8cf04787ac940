"""`grasp-runtime --port sim` on a running cell, whose endpoints are a JSON object in the variable `CELL`."""

import json
import os
import sys
from typing import Any

from runtime import cli
from runtime.commands import cell
from runtime.devices.cell_process import Endpoints


class RunningProcess:
    """Stands for the cell process that the run would start."""

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
