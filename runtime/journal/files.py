"""Files of a journal: the file being written, the sealed segments, and the rotation from one to the next.

Of the journal `J` the sealed segments are `J.000001`, `J.000002` and so on; `J` itself, the current file,
holds the latest records. A rotation writes the new file as `J.next`, renames `J` to the next segment, then
renames `J.next` to `J`. So at any moment the latest records are in `J`, or in `J.next` where there is no `J`.
`J.broken` keeps the records of a run whose journal was moved or truncated during the run.
"""

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from runtime.errors import JournalError
from runtime.journal.lines import Verified, checked
from runtime.shell import strict_json
from runtime.shell.files import bring_to_disk, oddity
from runtime.shell.sealed_lines import sealed_segments, segment

FLAGS = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
PIECE_BYTES = 1 << 20  # bytes copied at once
MOST_SEAL_BYTES = 4096


def next_of(path: Path) -> Path:
    """Path of `J.next`, the new file that a rotation writes and then renames to the journal `J`."""
    return path.with_name(f"{path.name}.next")


def broken_of(path: Path) -> Path:
    """Path of `J.broken`, which keeps the records of a run whose journal `J` was moved or truncated."""
    return path.with_name(f"{path.name}.broken")


def exists(path: Path) -> bool:
    """Whether any file of a journal exists."""
    if any(map(os.path.lexists, (path, next_of(path), broken_of(path)))):
        return True
    with contextlib.suppress(OSError):  # an invalid folder is reported when the journal is begun
        return bool(sealed_segments(path))
    return False


def check_whole(path: Path) -> list[Path]:
    """Lists the sealed segments of a journal, oldest first, and checks that none is missing.

    Raises:
        JournalError: a segment is missing, or the file `broken_of(path)` exists.
    """
    if os.path.lexists(broken_of(path)):
        raise JournalError(
            path,
            f"was moved or cut beneath a run, whose records are in {broken_of(path)}; put them back in their "
            "place (runtime/OUTCOMES.md), or move all of it away",
        )
    sealed = sealed_segments(path)
    for number, file in enumerate(sealed, 1):
        if file != segment(path, number):
            raise JournalError(path, f"its segment {segment(path, number)} is missing; put it back")
    return sealed


def start_of(path: Path) -> Verified:
    """State of a journal before the first record of its current file, by the seal of the last segment.

    Raises:
        JournalError: a segment is missing, or the last segment does not end with a seal.
    """
    sealed = check_whole(path)
    if not sealed:
        return Verified()
    last: Mapping[str, object] = {}
    with sealed[-1].open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - MOST_SEAL_BYTES, 0))
        lines = file.read().splitlines(keepends=True)
    with contextlib.suppress(JournalError, IndexError, KeyError, TypeError, ValueError):
        claimed = strict_json.parse(lines[-1])
        last = checked(sealed[-1], len(lines), lines[-1], claimed["seq"], claimed["previous"])
    if last.get("kind") != "seal":
        raise JournalError(sealed[-1], "does not end with its seal; put it back as it was")
    return Verified(str(last["digest"]), int(str(last["seq"])) + 1, segments=len(sealed))


def claim(path: Path) -> int:
    """Opens and locks the current file of a journal, without following a symbolic link.

    Creates the file if it is missing, and completes a rotation that a crash interrupted.

    Returns:
        The file's descriptor.

    Raises:
        JournalError: the file is not regular, is a segment, is written by another process, or is missing
            although there are sealed segments.
        OSError: the file cannot be opened.
    """
    check_whole(path)
    base, ending = path.with_suffix(""), path.suffix[1:]
    if ending.isdecimal() and (path in sealed_segments(base) or os.path.lexists(base)):
        raise JournalError(path, f"is a segment of {base}; name that one")
    if ending in ("broken", "next") and os.path.lexists(base):
        raise JournalError(path, f"is a name that {base} may need; choose another")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "its folder may not be written to")
    opened = path
    if not os.path.lexists(path) and sealed_segments(path):
        opened = next_of(path)
        if not os.path.lexists(opened):
            raise JournalError(
                path, "is missing, its sealed segments are there; put it back, or move them away"
            )
    file = opened_regular(opened, 0o644)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if opened != path:
            opened.rename(path)  # a rotation interrupted by a crash
        bring_to_disk(path.parent)
        _check_claimed(path, file)
    except BlockingIOError:
        os.close(file)
        raise _busy(path) from None
    except BaseException:  # Ctrl-C, too, must not leave the file claimed
        os.close(file)
        raise
    return file


def _check_claimed(path: Path, file: int) -> None:
    if displacement(path, file, os.fstat(file).st_size):  # sealed between opening and locking
        raise _busy(path)


def _busy(path: Path) -> JournalError:
    return JournalError(path, "is being written by another process; name another file")


def opened_regular(path: Path, mode: int, flags: int = 0) -> int:
    """Opens a regular file to append to it; creates a missing one with `mode`.

    Returns:
        The file's descriptor.

    Raises:
        JournalError: the path is no regular file.
        OSError: the file cannot be opened.
    """
    with contextlib.suppress(FileNotFoundError):
        _check_regular(path, path.lstat().st_mode)
    file = os.open(path, FLAGS | flags, mode)
    try:
        _check_regular(path, os.fstat(file).st_mode)
    except JournalError:
        os.close(file)
        raise
    return file


def _check_regular(path: Path, mode: int) -> None:
    if reason := oddity(mode):
        raise JournalError(path, f"cannot be written: {reason}; name another file")


def displacement(path: Path, file: int, size: int) -> str:
    """States what happened to an open file; "" if it is still at `path` and has `size` bytes."""
    opened = os.fstat(file)
    try:
        there = path.lstat()
    except OSError:
        return "renamed" if opened.st_nlink else "removed"
    if (there.st_dev, there.st_ino) != (opened.st_dev, opened.st_ino):
        return "replaced by another file"
    if opened.st_size < size:
        return f"cut from {size} to {opened.st_size} bytes"
    return "written to by somebody else" if opened.st_size > size else ""


def copy_aside(path: Path, file: int, size: int) -> tuple[int, int]:
    """Creates a journal's `J.broken` and copies the first `size` bytes of the journal's open file into it.

    Returns:
        The descriptor of `J.broken`, locked, and its length: `size` or, for a truncated journal, 0.

    Raises:
        OSError: `J.broken` cannot be written, or exists already.
    """
    aside = os.open(broken_of(path), FLAGS | os.O_EXCL, stat.S_IMODE(os.fstat(file).st_mode))
    try:
        fcntl.flock(aside, fcntl.LOCK_EX | fcntl.LOCK_NB)
        whole = size if os.fstat(file).st_size >= size else 0
        for at in range(0, whole, PIECE_BYTES):
            write_all(aside, os.pread(file, min(PIECE_BYTES, whole - at), at))
        os.fsync(aside)
        bring_to_disk(path.parent)
    except BaseException:
        os.close(aside)
        raise
    return aside, whole


def rotate(path: Path, file: int, number: int, line: bytes) -> int:
    """Renames the current file of a journal to the segment `number`, and starts a new file with a line.

    Returns:
        The new file's descriptor, locked; the descriptor of the old file stays open.

    Raises:
        OSError: a file cannot be written. The next opening of the journal completes a half-done rotation.
    """
    name = next_of(path)
    new = opened_regular(name, 0o644, os.O_TRUNC)
    try:
        fcntl.flock(new, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.fchmod(new, stat.S_IMODE(os.fstat(file).st_mode))
        write_all(new, line)
        os.fsync(new)
        path.rename(segment(path, number))
        name.rename(path)
        bring_to_disk(path.parent)
    except BaseException:
        os.close(new)
        raise
    return new


def write_all(file: int, data: bytes) -> None:
    """Writes all of the data to a descriptor, which may take several calls."""
    while data:
        data = data[os.write(file, data) :]
