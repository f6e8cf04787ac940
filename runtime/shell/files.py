"""Reads and writes the files of commands; an output is written as a whole or not at all.

`writing` writes a draft beside the output file, and renames the draft at the end. Before a command works,
`usable` checks that the output is a regular file, or standard output if the command allows it, and that it is
none of the files that the command reads.
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
FORMATS = frozenset(
    [
        ".png",
        ".svg",
        ".pdf",
        ".csv",
        ".dxf",
        ".html",
        ".json",
        ".jsonl",
        ".msgpack",
        ".stl",
        ".toml",
        ".zip",
    ]
)  # suffixes of files that a wrong -o must not overwrite


class OutputError(UsageError, OSError):
    """An output cannot be written: its path is unusable, or the disk refuses."""


def usable(path: Path, *others: Path | None, stdout: bool = False) -> Path:
    """Checks that an output file can be written, before a command begins to work; returns its path.

    Args:
        path: the file, which may not exist yet.
        others: other files that the command reads or writes; None is ignored.
        stdout: whether standard output is allowed.

    Raises:
        OutputError: the file is a link, a folder, a device or one of `others`; its folder does not exist; or
            this user may not write it.
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


def fitting(path: Path, what: str, suffix: str) -> Path:
    """Checks and returns the path of an output, which should end in `suffix`.

    A path without a suffix, or with a suffix that no format has, is allowed, too.

    Raises:
        UsageError: the path has the suffix of another one of `FORMATS`.
    """
    if path.suffix.lower() in FORMATS and path.suffix.lower() != suffix:
        name = path.with_suffix(suffix)
        raise UsageError(f"-o {path}: what is written is {what}; name it {name}")
    return path


def folder(path: Path, *others: Path | None) -> Path:
    """Creates a folder for output files, before a command begins to work; returns its path.

    Args:
        path: the folder, which may exist already.
        others: folders that the command reads; None is ignored.

    Raises:
        OutputError: the folder cannot be created, or is one of `others`.
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
    """Context to write a file as a whole: yields the path of a draft, which at the end replaces the file.

    If the context ends with an error, the file stays as it was. The draft has the file's suffix. If `path` is
    one of `STDOUT`, the draft is copied to standard output instead.

    Raises:
        OutputError: the file cannot be written.
    """
    if path in STDOUT:
        import tempfile  # loads compressors, 0.7 MiB in all, which no run of a cell needs

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
    """Creates an empty draft; if the output file exists, the draft gets this file's owner and mode.

    Args:
        draft: path of the draft.
        path: path of the file that the draft will replace.
    """
    old = path.stat() if path.exists() else None
    # O_EXCL follows no link. The draft of a private file is private before it has content.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    handle = os.open(draft, flags, 0o666 if old is None else 0o600)
    try:
        if old is not None:
            with suppress(PermissionError):  # then another user's file becomes this user's
                os.fchown(handle, old.st_uid, old.st_gid)
            os.fchmod(handle, old.st_mode & 0o777)
    finally:
        os.close(handle)


def quoted(path: Path | str) -> str:
    """Quotes a path for a command line in a message, which people may copy; "-x" becomes "./-x"."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def write(path: Path, text: str) -> None:
    """Writes a text file in UTF-8, as a whole or not at all (see `writing`)."""
    with writing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def words_of(path: Path) -> TextIO:
    """Returns the stream for messages: standard error if `path` is standard output, else standard output."""
    return sys.stderr if path in STDOUT else sys.stdout


def _objection(path: Path) -> str:
    """Returns the reason why a file cannot be written; "" if it can be written.

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
    """Says what an irregular file is, such as "it is a folder"; returns "" for a regular file.

    Args:
        mode: the file's `st_mode`.
    """
    if stat.S_ISREG(mode):
        return ""
    if stat.S_ISDIR(mode):
        return "it is a folder"
    return "it is a symbolic link" if stat.S_ISLNK(mode) else "it is no regular file"


def same(one: Path, other: Path) -> bool:
    """Whether two paths name the same file, which need not exist."""
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def read_regular(path: Path, most_bytes: int) -> tuple[bytes, int]:
    """Reads a regular file; returns its bytes and its `st_mode`.

    If the path is a pipe, raises an error at once and does not wait for a writer.

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
    """Reads an input file with `read_regular`; returns its bytes and its `st_mode`.

    Args:
        path: the file.
        most_bytes: size above which the file is refused.
        name: name of the file in the error's message.
        remedy: end of the error's message.

    Raises:
        InputError: the file cannot be read, is not regular or is too large.
    """
    try:
        return read_regular(path, most_bytes)
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {error.strerror}{remedy}") from error


def bring_to_disk(path: Path) -> None:
    """Waits until the content of a file, or the list of files of a folder, is on the disk (fsync)."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
