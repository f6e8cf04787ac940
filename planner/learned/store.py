"""A folder of finished work, named by what it depends on.

An entry is moved to its place whole, with a digest of its name and content that is verified when it is read:
what a power cut left behind is never used. Several processes may share a folder; equal names mean equal
content.
"""

import hashlib
import os
import re
import tempfile
import time
import warnings
from contextlib import suppress
from pathlib import Path

DIGEST = 32
LIMIT_BYTES = 4 * 2**30  # Size above which the entries not used for longest are removed
STALE_S = 3600.0  # Age at which a half-written file counts as left by a process that was killed

_KEY = re.compile(r"[0-9a-f]{8,}")


class StoreWarning(UserWarning):
    """An entry or the folder cannot be used; the work is done again, only slower."""


class Store:
    """Entries in a folder, made when the first is written. Each kind of trouble is warned about once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._warned: set[str] = set()

    def get(self, key: str) -> bytes | None:
        """An entry by its name in lower-case hexadecimal; None if absent or unusable (with a warning)."""
        path = self._path(key)
        try:
            content = path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            self._warn("read", f"{path}: cannot be read: {error.strerror}; its work is done again")
            return None
        data = content[DIGEST:]
        if content[:DIGEST] != _digest(key, data):
            self._warn("damage", f"{path}: damaged; it is made again, as are any others like it")
            return None
        with suppress(OSError):
            os.utime(path)
        return data

    def put(self, key: str, data: bytes) -> None:
        """Writes an entry, whole or not at all; where the folder refuses, warns and goes on without.

        Whatever writes the same key (lower-case hexadecimal) must write the same data.
        """
        path = self._path(key)
        if "write" in self._warned:
            return
        draft = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, draft = tempfile.mkstemp(suffix=".part", prefix=".", dir=path.parent)
            with open(handle, "wb") as file:  # noqa: PTH123
                file.write(_digest(key, data))
                file.write(data)
            os.replace(draft, path)  # noqa: PTH105
        except OSError as error:
            reason = f"{self.folder}: cannot be written: {error.strerror}"
            self._warn(
                "write", f"{reason}; going on without the cache (--cache-dir names another folder)"
            )
            with suppress(OSError):
                if draft is not None:
                    os.unlink(draft)  # noqa: PTH108

    def trim(self, limit_bytes: int = LIMIT_BYTES) -> None:
        """Removes what was not used for longest beyond `limit_bytes`, and drafts that nobody will finish."""
        entries, now = [], time.time()
        for path in self.folder.glob("??/*"):
            with suppress(OSError):
                status = path.stat()
                if path.suffix == ".part":
                    if now - status.st_mtime > STALE_S:
                        path.unlink()
                else:
                    entries.append((status.st_mtime, status.st_size, path))
        excess = sum(size for _, size, _ in entries) - limit_bytes
        for _, size, path in sorted(entries):
            if excess <= 0:
                break
            with suppress(OSError):
                path.unlink()
                excess -= size

    def _path(self, key: str) -> Path:
        if not _KEY.fullmatch(key):
            raise ValueError(f"the key {key!r} is not lower-case hexadecimal")
        return self.folder / key[:2] / key[2:]

    def _warn(self, kind: str, message: str) -> None:
        if kind not in self._warned:
            self._warned.add(kind)
            warnings.warn(message, StoreWarning, stacklevel=3)


def _digest(key: str, data: bytes) -> bytes:
    digest = hashlib.sha256(key.encode())
    digest.update(data)
    return digest.digest()
