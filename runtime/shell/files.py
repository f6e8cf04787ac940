"""Atomic writing of files by all commands: to a draft beside the file, which is then renamed.

Only regular files are written, or standard output where a command offers that, and never a file that the
command reads. `usable` checks this before the work, `writing` writes.
"""

import errno
import os
import shlex
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from runtime.shell.errors import InputError, UsageError

STDOUT = frozenset({Path("-"), Path("/dev/stdout")})
LONGEST_STEM = 40


class OutputError(UsageError, OSError):
    """An output cannot be written: its path is unusable, or the disk refuses."""


def usable(path: Path, *others: Path | None, stdout: bool = False) -> Path:
    """Checks, before the work, that an output file may be written; returns its path.

    Args:
        path: the file, which may not exist yet.
        others: other files that the command reads or writes; None for an option that was not given.
        stdout: whether standard output is allowed.

    Raises:
        OutputError: the path is a link, a folder, a device or one of the others; its folder does not exist;
            or the file may not be written.
    """
    if stdout and path in STDOUT:
        return path
    try:
        reason = _objection(path)
    except OSError as error:
        reason = error.strerror or str(error)
    for other in others:
        if not reason and other is not None and same(path, other):
            reason = f"it is the same file as {other}"
    if reason:
        raise OutputError(f"{path} cannot be written: {reason}; name another file")
    return path


def folder(path: Path, *others: Path | None) -> Path:
    """Creates a folder for output files, before the work; returns its path.

    Args:
        path: the folder, which may exist.
        others: folders that the command reads, as in `usable`.

    Raises:
        OutputError: the folder cannot be created, or is one of the others.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path} cannot be created: {error.strerror}; name another folder"
        ) from error
    for other in others:
        if other is not None and same(path, other):
            raise OutputError(
                f"{path} cannot be written to: the command reads it; name another folder"
            )
    return path


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Context manager that yields the path of a draft, and replaces the file by the draft on success.

    The draft has the suffix of the file. If the path is one of `STDOUT`, the draft is copied to standard
    output instead.

    Raises:
        OutputError: the file cannot be written.
    """
    if path in STDOUT:
        import tempfile  # with its compressors 0.7 MiB, which no run of the cell needs

        with tempfile.TemporaryDirectory() as folder:
            draft = Path(folder) / "draft"
            yield draft
            sys.stdout.buffer.write(draft.read_bytes())
            sys.stdout.flush()
        return
    draft = path.with_name(f".{path.stem[:LONGEST_STEM]}.{os.urandom(4).hex()}{path.suffix}")
    usable(path)
    try:
        _begin(draft, path)
        try:
            yield draft
            bring_to_disk(draft)
            usable(path)
            draft.replace(path)
        finally:  # Ctrl-C, too, must not leave a draft behind
            with suppress(OSError):
                draft.unlink(missing_ok=True)
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"{path} cannot be written: {reason}; free the disk or name another file"
        ) from error


def _begin(draft: Path, path: Path) -> None:
    """Creates an empty draft with the owner and mode of the file that it replaces, if there is one."""
    old = path.stat() if path.exists() else None
    # New, so never through somebody's link; a private file is private before it has content.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    handle = os.open(draft, flags, 0o666 if old is None else 0o600)
    try:
        if old is not None:
            with suppress(PermissionError):  # another user's file in our folder becomes ours
                os.fchown(handle, old.st_uid, old.st_gid)
            os.fchmod(handle, old.st_mode & 0o777)
    finally:
        os.close(handle)


def quoted(path: Path | str) -> str:
    """Quotes a path for a command line in a message; a leading "-" becomes "./-"."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def write(path: Path, text: str) -> None:
    """Writes a text as UTF-8, see `writing`."""
    with writing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def words_of(path: Path) -> TextIO:
    """The stream for a command's messages: standard error if its output `path` is standard output."""
    return sys.stderr if path in STDOUT else sys.stdout


def _objection(path: Path) -> str:
    """Returns why a file cannot be written, "" if it can.

    Raises:
        OSError: the path cannot be inspected.
    """
    if path in STDOUT:
        return "this command has no use for standard output"
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}"
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        writable = os.access(path.parent, os.W_OK | os.X_OK)
        return "" if writable else "its folder may not be written to"
    return oddity(mode) or ("" if os.access(path, os.W_OK) else "it is read-only")


def oddity(mode: int) -> str:
    """The kind of a file that is not regular, as "it is a folder"; "" for a regular one."""
    if stat.S_ISREG(mode):
        return ""
    if stat.S_ISDIR(mode):
        return "it is a folder"
    return "it is a symbolic link" if stat.S_ISLNK(mode) else "it is no regular file"


def same(one: Path, other: Path) -> bool:
    """Whether two paths name the same file, existing or not."""
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def read_regular(path: Path, most_bytes: int) -> tuple[bytes, int]:
    """Returns the bytes of a regular file and its `st_mode`.

    Never blocks on a pipe without a writer.

    Raises:
        OSError: the file cannot be read, is not regular, or is larger than `most_bytes`.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        mode = os.fstat(file).st_mode
        if reason := oddity(mode):
            raise OSError(errno.EINVAL, reason, str(path))
        with open(file, "rb", closefd=False) as opened:
            data = opened.read(most_bytes + 1)
        if len(data) > most_bytes:
            kib = most_bytes >> 10
            limit = f"{kib} KiB" if kib % 1024 else f"{kib >> 10} MiB"
            raise OSError(errno.EFBIG, f"it is larger than {limit}", str(path))
        return data, mode
    finally:
        os.close(file)


def read_input(path: Path, most_bytes: int, name: str, remedy: str = "") -> tuple[bytes, int]:
    """Returns the bytes of an input file and its `st_mode`, as `read_regular`.

    Raises:
        InputError: the file cannot be read; the message calls it `name`, and ends with the remedy.
    """
    try:
        return read_regular(path, most_bytes)
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {error.strerror}{remedy}") from error


def bring_to_disk(path: Path) -> None:
    """Waits until a file, or a folder's list of files, is on the disk."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
