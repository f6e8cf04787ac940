"""A project folder: drawings, plans and what else is in it. There is no other state.

A plan's log is locked by the process that plans, so whoever opens the folder knows which plans are under way.
"""

import contextlib
import fcntl
import os
import subprocess
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from planner.part.importers.file import SUFFIXES
from planner.studio.log import Log, log_of
from planner.studio.steps import PYTHON, written_for
from runtime.shell.errors import InputError, UsageError
from runtime.shell.files import bring_to_disk, read_regular

MOST_LOG_BYTES = 4 << 20
LONGEST_NAME = 120  # characters; room for the suffixes of what is written
PICTURE, LOG = ".look.svg", ".plan.jsonl"  # suffixes
OPTIONS = (
    *("units", "scale", "contour", "gripper", "fingers", "radius", "turn", "distance"),
    *("thickness", "budget"),
)  # of `squeezetree try`, in the order of a command line


class File(NamedTuple):
    """A regular file of the folder."""

    name: str
    size: int  # bytes


class Plan(NamedTuple):
    """A plan, as its log and the files beside it tell."""

    name: str
    running: bool
    log: Log
    files: dict[str, str]  # what it wrote so far, by what it is


class Folder:
    """A project folder; names that come from a page are those of its own regular files."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self._lock = threading.Lock()

    def files(self) -> list[File]:
        """Its regular files, by name; no links, nothing hidden, no name that is not text."""
        result = []
        with os.scandir(self.path) as entries:
            for entry in entries:
                with contextlib.suppress(OSError, UsageError):
                    if entry.is_file(follow_symlinks=False):
                        result.append(File(checked(entry.name), entry.stat().st_size))
        return sorted(result)

    def read(self, name: str, most_bytes: int) -> bytes:
        """A file's content.

        Raises:
            UsageError: the name is none of a file of this folder.
            OSError: it cannot be read.
        """
        path = self.path / checked(name)
        if path.is_symlink():
            raise UsageError(f"{name}: is a symbolic link, which the studio does not follow")
        return read_regular(path, most_bytes)[0]

    def add(self, name: str, data: bytes) -> str:
        """Keep a drawing; returns its name, numbered where another drawing has it.

        Raises:
            UsageError: the name cannot be that of a drawing.
            OSError: it cannot be written.
        """
        suffix = Path(checked(name)).suffix
        if suffix.lower() not in SUFFIXES:
            raise UsageError(f"{name}: is no drawing; those end in {', '.join(SUFFIXES)}")
        stem, number = name.removesuffix(suffix), 1
        draft = self.path / f".{os.urandom(8).hex()}.draft"
        try:
            draft.write_bytes(data)
            bring_to_disk(draft)
            while True:
                path = self.path / (name if number == 1 else f"{stem}-{number}{suffix}")
                try:
                    os.link(draft, path)  # never over a file that is there
                except FileExistsError:
                    if not path.is_symlink() and path.is_file() and path.read_bytes() == data:
                        return path.name
                    number += 1
                else:
                    return path.name
        finally:
            draft.unlink(missing_ok=True)

    def arguments(self, drawing: str, settings: Mapping[str, Any]) -> list[str]:
        """A page's settings as options of `squeezetree try`; those left empty keep its defaults.

        Raises:
            UsageError: the drawing is not there, or a setting is unknown.
        """
        if checked(drawing) not in (file.name for file in self.files()):
            raise InputError("is no file of this folder any more; choose another", where=drawing)
        unknown = settings.keys() - set(OPTIONS)
        if unknown or not all(isinstance(value, str) for value in settings.values()):
            raise UsageError(f"settings are {', '.join(OPTIONS)}, each a text")
        return [
            f"--{name}={settings[name].strip()}"
            for name in OPTIONS
            if settings.get(name, "").strip()
        ]

    def begin(self, drawing: str, arguments: list[str]) -> str:
        """Start to plan in a process of its own; returns the plan's name.

        Raises:
            UsageError: another plan of this folder is under way.
            OSError: the folder cannot be written to.
        """
        with self._lock:
            under_way = [plan.name for plan in self.plans() if plan.running]
            if under_way:
                raise UsageError(f"{under_way[0]} is being planned; stop it, or wait for it")
            name, log = self._begun(Path(drawing).stem)
            words = [name, drawing, *arguments]
            with open(log, "wb") as file:  # noqa: PTH123
                child = subprocess.Popen(
                    [*PYTHON, "planner.studio.steps", *words],
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=file,
                    cwd=self.path,
                    start_new_session=True,
                )
            threading.Thread(target=child.wait, daemon=True).start()  # no zombie stays
        return name

    def stop(self, name: str) -> None:
        """Ask a plan to end with what stands.

        Raises:
            UsageError: it is not under way.
            OSError: the folder cannot be written to.
        """
        if checked(name) not in (plan.name for plan in self.plans() if plan.running):
            raise UsageError(f"{name} is not being planned")
        (self.path / written_for(name)["stop"]).touch()

    def plans(self) -> list[Plan]:
        """All plans that have a log, the latest first."""
        there = {file.name for file in self.files()}
        logs = [self.path / name for name in there if name.endswith(LOG)]
        plans = []
        for path in logs:
            with contextlib.suppress(OSError):  # gone meanwhile
                plans.append((path.stat().st_mtime_ns, self._plan(path, there)))
        return [plan for _, plan in sorted(plans, key=lambda pair: pair[0], reverse=True)]

    def _plan(self, path: Path, there: set[str]) -> Plan:
        name = path.name.removesuffix(LOG)
        running = _is_locked(path)
        log = log_of(read_regular(path, MOST_LOG_BYTES)[0])
        kept = {what: file for what, file in written_for(name).items() if file in there}
        return Plan(name, running, log, kept)

    def _begun(self, stem: str) -> tuple[str, int]:
        """The first name that no file of a plan has yet, and a descriptor of its log, locked."""
        number = 1
        while True:
            name = stem if number == 1 else f"{stem}-{number}"
            files = written_for(name)
            if not any(os.path.lexists(self.path / file) for file in files.values()):
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
                with contextlib.suppress(FileExistsError):
                    log = os.open(self.path / files["log"], flags, 0o666)
                    fcntl.flock(log, fcntl.LOCK_EX)
                    return name, log
            number += 1


def checked(name: str) -> str:
    """The name of a file in a folder, and of nothing elsewhere.

    Raises:
        UsageError: it is empty, hidden, too long, no text, or has a slash or a control character in it.
    """
    printable = isinstance(name, str) and all(ch.isprintable() for ch in name)
    if not printable or "/" in name or "\\" in name or not name or name.startswith("."):
        raise UsageError(f"{name!r}: is no name of a file here; no slashes, no dot in front")
    if len(name) > LONGEST_NAME:
        raise UsageError(f"{name[:LONGEST_NAME]}...: is longer than {LONGEST_NAME} characters")
    return name


def _is_locked(path: Path) -> bool:
    """Whether a process that writes a log is alive."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
