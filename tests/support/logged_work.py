"""Functions for worker processes that tests start and kill; without kernels, they start at once."""

import os
import time
from pathlib import Path

from runtime.shell.errors import InputError


def logged(log: str, seconds: float, item: int) -> int:
    """Returns the square of `item`; writes a line with the process's id to a file before and after."""
    with Path(log).open("a") as file:
        file.write(f"{item} begun by {os.getpid()}\n")
    time.sleep(seconds)
    with Path(log).open("a") as file:
        file.write(f"{item} done by {os.getpid()}\n")
    return item * item


def refused(item: int) -> int:
    """Raises the error of an invalid job."""
    raise InputError(f"is no number, unlike {item}", section="goal", key="distance_mm")
