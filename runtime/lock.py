"""One process a device: a lock by the device's own name, whatever path or address it was named by."""

import contextlib
import fcntl
import hashlib
import os
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Self

from runtime.errors import PortBusyError


class PortLock:
    """Held while a process of ours works with a device; gone with the process, however it ends.

    Args:
        port: a tty's path or an address. Links such as /dev/serial/by-id are followed to the device.
        folder: where lock files are; None for the user's runtime folder, or the machine's temporary one.

    Raises:
        PortBusyError: another process holds it; the message tells which.
    """

    def __init__(self, port: str, folder: Path | None = None) -> None:
        digest = hashlib.sha256(_device(port).encode()).hexdigest()[:16]
        self.path = (folder or _folder()) / f"squeezetree-{digest}.lock"
        self._file = _locked(self.path, port)
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode("ascii"), 0)

    def close(self) -> None:
        """Let go of it; the second time does nothing."""
        file, self._file = self._file, -1
        if file < 0:
            return
        # Removed while still locked: whoever opened this file meanwhile finds, once it has the lock, that the
        # path names it no longer. A file that somebody else put there is not ours to remove.
        with contextlib.suppress(OSError):
            if _names(self.path, file):
                self.path.unlink()
        os.close(file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _locked(path: Path, port: str) -> int:
    """A descriptor of the file at a path, locked while the path names it."""
    while True:
        file = _opened(path, port)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(file, 100, 0).decode("ascii", "replace").strip() or "unknown"
            os.close(file)
            raise PortBusyError(
                f"port {port} is in use by another process of squeezetree (process {owner}); stop that first"
            ) from None
        if _names(path, file):
            return file
        os.close(file)  # its owner removed it between our opening and our locking it


def _opened(path: Path, port: str) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise PortBusyError(
            f"port {port}: its lock {path} cannot be opened ({error.strerror}); "
            "another user may be working with it"
        ) from error


def _names(path: Path, file: int) -> bool:
    """Whether a path still names an open file."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False


def _device(port: str) -> str:
    """The device's own name: an address without its settings, or the file that a link leads to."""
    if "://" in port or port.startswith("can:"):
        return port.partition("?")[0]
    return os.path.realpath(port)


def _folder() -> Path:
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and os.access(runtime, os.W_OK):
        return Path(runtime)
    return Path(tempfile.gettempdir())
