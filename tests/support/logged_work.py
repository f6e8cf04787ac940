"""Functions for worker processes that tests start and kill.

The module imports no compiled kernels, so that the processes start quickly.
"""

import os
import time
from pathlib import Path

from runtime.shell.errors import InputError


def logged(log: str, seconds: float, item: int) -> int:
    """Waits for some seconds and returns the square of `item`.

    Before and after, it writes a line with the item and the id of the process to the file `log`.
    """
    with Path(log).open("a") as file:
        file.write(f"{item} begun by {os.getpid()}\n")
    time.sleep(seconds)
    with Path(log).open("a") as file:
        file.write(f"{item} done by {os.getpid()}\n")
    return item * item


def refused(item: int) -> int:
    """Raises the error of an invalid job."""
    raise InputError(f"is no number, unlike {item}", section="goal", key="distance_mm")
