"""Work for processes that a test starts and kills, which needs no kernels and so starts at once."""

import os
import time
from pathlib import Path

from runtime.shell.errors import InputError


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
    raise InputError(f"is no number, unlike {item}", section="goal", key="distance_mm")
