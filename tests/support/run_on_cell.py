"""`grasp-runtime --port sim` on a cell that runs already: its endpoints are the JSON object in `CELL`."""

import json
import os
import sys
from typing import Any

from runtime import cli
from runtime.commands import cell
from runtime.devices.cell_process import Endpoints


class RunningProcess:
    """The cell that a run would have started."""

    def __init__(self, *_: Any, **__: Any) -> None:
        endpoints = json.loads(os.environ["CELL"])
        self.endpoints = Endpoints(**{name: endpoints.get(name, "") for name in Endpoints._fields})

    def __enter__(self) -> "RunningProcess":
        return self

    def __exit__(self, *_: object) -> None:
        """It stays."""


if __name__ == "__main__":
    cell.CellProcess = RunningProcess  # type: ignore[assignment,misc]
    sys.exit(cli.main())
