"""The plans of a project folder: lists them with their results, and starts and stops planning.

The planning process locks the plan's log, so every reader of the folder knows which plans are running.
"""

import contextlib
import fcntl
import os
import subprocess
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from planner.studio.folder import Folder, checked
from planner.studio.log import Log, log_of
from planner.studio.steps import PYTHON, written_for
from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import read_regular

MOST_LOG_BYTES = 64 << 20
LOG = written_for("")["log"]  # suffix
OPTIONS = (
    *("units", "scale", "contour", "gripper", "fingers", "radius", "turn", "distance"),
    *("thickness", "budget"),
)  # options of `squeezetree try`, in the order of a command line


class Plan(NamedTuple):
    """The state of a plan, read from its log and from the files beside the log."""

    name: str
    running: bool
    trying: bool  # whether the what-if trials are running, which follow the plan
    log: Log
    files: dict[str, str]  # files written so far, by kind


class Plans:
    """The plans of a project folder."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self._lock = threading.Lock()

    def arguments(self, drawing: str, settings: Mapping[str, Any]) -> list[str]:
        """Converts a page's settings to options of `squeezetree try`; an empty setting gives no option.

        Raises:
            UsageError: the name of the drawing is not allowed, or a setting is unknown or not a text.
            InputError: the folder has no such drawing.
        """
        if checked(drawing) not in (file.name for file in self.folder.files()):
            raise InputError("is no file of this folder any more; choose another", where=drawing)
        unknown = settings.keys() - set(OPTIONS)
        if unknown or not all(isinstance(value, str) for value in settings.values()):
            raise UsageError(f"settings are {', '.join(OPTIONS)}, each a text")
        stated = {name: settings.get(name, "").strip() for name in OPTIONS}
        return [f"--{name}={text}" for name, text in stated.items() if text]

    def begin(self, drawing: str, arguments: list[str]) -> str:
        """Starts planning in a separate process; returns the plan's name.

        What-if trials of other plans are asked to end, since planning has priority.

        Raises:
            UsageError: another plan of this folder is under way.
            OSError: the folder cannot be written to.
        """
        with self._lock:
            under_way = [plan.name for plan in self.all() if plan.running]
            if under_way:
                raise UsageError(f"{under_way[0]} is being planned; stop it, or wait for it")
            for plan in self.all():
                if plan.trying:  # planning has priority over trials of other goals
                    self.stop(plan.name)
            name, log = self._begun(Path(drawing).stem)
            words = [name, drawing, *arguments]
            with open(log, "wb") as file:  # noqa: PTH123
                child = subprocess.Popen(
                    [*PYTHON, "planner.studio.steps", *words],
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=file,
                    cwd=self.folder.path,
                    start_new_session=True,
                )
            threading.Thread(target=child.wait, daemon=True).start()  # reaps the process
        return name

    def stop(self, name: str) -> None:
        """Asks a plan to end with the result so far.

        Raises:
            UsageError: there is no such plan, or its planning and its what-if trials have ended.
            OSError: the folder cannot be written to.
        """
        if checked(name) not in (plan.name for plan in self.all() if plan.running or plan.trying):
            raise UsageError(f"{name} is not being planned")
        (self.folder.path / written_for(name)["stop"]).touch()

    def all(self) -> list[Plan]:
        """All plans of the folder that have a log; the plan with the latest change of its log comes first."""
        there = {file.name for file in self.folder.files()}
        logs = [self.folder.path / name for name in there if name.endswith(LOG)]
        plans = []
        for path in logs:
            with contextlib.suppress(OSError):  # deleted meanwhile
                plans.append((path.stat().st_mtime_ns, self._plan(path, there)))
        return [plan for _, plan in sorted(plans, key=lambda pair: pair[0], reverse=True)]

    def _plan(self, path: Path, there: set[str]) -> Plan:
        name = path.name.removesuffix(LOG)
        alive = _is_locked(path)
        log = log_of(read_regular(path, MOST_LOG_BYTES)[0])
        kept = {what: file for what, file in written_for(name).items() if file in there}
        return Plan(name, alive and log.exit is None, alive and log.exit is not None, log, kept)

    def _begun(self, stem: str) -> tuple[str, int]:
        """Creates and locks the log of a new plan; returns the plan's name, and the log's file descriptor.

        The name is `stem`, with a number if another plan has this name.
        """
        number = 1
        while True:
            name = stem if number == 1 else f"{stem}-{number}"
            files = written_for(name)
            if not any(os.path.lexists(self.folder.path / file) for file in files.values()):
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
                with contextlib.suppress(FileExistsError):
                    log = os.open(self.folder.path / files["log"], flags, 0o666)
                    fcntl.flock(log, fcntl.LOCK_EX)
                    return name, log
            number += 1


def _is_locked(path: Path) -> bool:
    """Whether a living process holds the lock on a log, as the process that writes the log does."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
