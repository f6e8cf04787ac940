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
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise PortBusyError(
                f"port {port}: its lock {self.path} cannot be opened ({error.strerror}); "
                "another user may be working with it"
            ) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(self._file, 100, 0).decode("ascii", "replace").strip() or "unknown"
            os.close(self._file)
            raise PortBusyError(
                f"port {port} is in use by another process of squeezetree (process {owner}); stop that first"
            ) from None
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode("ascii"), 0)

    def close(self) -> None:
        """Let go of it; the file stays, since removing it would let two processes lock two files."""
        with contextlib.suppress(OSError):
            os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
