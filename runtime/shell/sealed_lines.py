"""The hash-chained lines of journals: each is a JSON object whose last field, `digest`, seals the line.

The digest is the SHA-256 of the line without this field. The last field but one, `previous`, is the digest of
the preceding line; in the first line it is `GENESIS`. A long journal has several files: sealed segments, then
the journal's current file. The chain continues from one file to the next.
"""

import hashlib
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from runtime.shell.errors import UsageError

GENESIS = "0" * 64
_MARK, _END = b',"digest":"', b'"}\n'
_LENGTH = len(_MARK) + len(GENESIS) + len(_END)


def sealed(body: bytes) -> tuple[bytes, str]:
    """Adds the field `digest` to a JSON object; returns the line, with its line break, and the digest.

    Args:
        body: the object as JSON text on one line, without a line break.
    """
    digest = hashlib.sha256(body).hexdigest()
    return body[:-1] + _MARK + digest.encode("ascii") + _END, digest


def is_intact(line: bytes) -> bool | None:
    """Whether the digest at the end of a line matches the line; None if the line has no digest."""
    if not line[-_LENGTH:].startswith(_MARK):
        return None
    return line == sealed(line[:-_LENGTH] + b"}")[0]


def segment(path: Path, number: int) -> Path:
    """Path of a sealed segment of the journal at `path`; the segments are numbered from 1."""
    return path.with_name(f"{path.name}.{number:06d}")


def sealed_segments(path: Path) -> list[Path]:
    """Paths of the existing sealed segments of the journal at `path`, in order.

    Raises:
        OSError: the journal's folder cannot be read.
    """
    name = re.compile(re.escape(path.name) + r"\.(\d{6,})")
    matches = [name.fullmatch(file.name) for file in path.parent.iterdir()]
    return [segment(path, number) for number in sorted(int(match[1]) for match in matches if match)]


def check_distinct(paths: Iterable[Path]) -> None:
    """Checks that no two journals have a file in common, or files that begin with the same record.

    Files that cannot be read are left to the reader of the journals.

    Raises:
        UsageError: a journal is named twice, or one is a copy or a segment of another.
    """
    seen: dict[bytes, tuple[int, Path]] = {}
    for number, path in enumerate(paths):
        with suppress(OSError):
            for file in (*sealed_segments(path), path):
                with file.open("rb") as lines:
                    first = lines.readline()
                earlier, other = seen.setdefault(first, (number, path))
                if first and earlier != number:
                    problem = (
                        f"holds parts of {other} again; name each journal once, without copies"
                    )
                    raise UsageError(f"journal {path}: {problem}")
