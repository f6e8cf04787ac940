"""A project folder and its files: the studio's only state. No name of a file can point outside the folder."""

import contextlib
import os
from pathlib import Path
from typing import NamedTuple

from planner.part.importers.file import SUFFIXES
from runtime.shell.errors import UsageError
from runtime.shell.files import bring_to_disk, read_regular

LONGEST_NAME, LONGEST_BYTES = 120, 200  # characters, bytes; they leave room for suffixes


class File(NamedTuple):
    """A regular file of the folder."""

    name: str
    size: int  # bytes


class Folder:
    """A project folder; a name from a page can only refer to a regular file in it."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()

    def files(self) -> list[File]:
        """The regular files of the folder, sorted by name; no links, and no names that `checked` refuses."""
        result = []
        with os.scandir(self.path) as entries:
            for entry in entries:
                with contextlib.suppress(OSError, UsageError):
                    if entry.is_file(follow_symlinks=False):
                        result.append(File(checked(entry.name), entry.stat().st_size))
        return sorted(result)

    def read(self, name: str, most_bytes: int) -> bytes:
        """Returns the content of a file.

        Raises:
            UsageError: the name is not allowed, or names a symbolic link.
            OSError: the file is missing or cannot be read.
        """
        path = self.path / checked(name)
        if path.is_symlink():
            raise UsageError(f"{name}: is a symbolic link, which the studio does not follow")
        return read_regular(path, most_bytes)[0]

    def add(self, name: str, data: bytes) -> str:
        """Stores a drawing; returns its name, with a number if another drawing has the name already.

        Raises:
            UsageError: a drawing cannot have this name.
            OSError: the drawing cannot be written.
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
                    os.link(draft, path)  # never overwrites a file
                except FileExistsError:
                    if not path.is_symlink() and path.is_file() and path.read_bytes() == data:
                        return path.name
                    number += 1
                else:
                    return path.name
        finally:
            draft.unlink(missing_ok=True)


def checked(name: str) -> str:
    """Checks and returns the name of a file in a folder.

    Raises:
        UsageError: the name is empty, too long or not a string, begins with a dot, or has a slash, a
            backslash or a character in it that cannot be printed.
    """
    printable = isinstance(name, str) and all(ch.isprintable() for ch in name)
    if not printable or "/" in name or "\\" in name or not name or name.startswith("."):
        raise UsageError(f"{name!r}: is no name of a file here; no slashes, no dot in front")
    if len(name) > LONGEST_NAME:
        raise UsageError(
            f"{name[:LONGEST_NAME]}...: is longer than {LONGEST_NAME} characters; rename it"
        )
    if len(os.fsencode(name)) > LONGEST_BYTES:
        raise UsageError(f"{name}: is longer than {LONGEST_BYTES} bytes; rename it")
    return name
