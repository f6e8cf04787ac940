"""Runs a program as a child process that exchanges lines of text, and ends when its input is closed."""

import contextlib
import os
import select
import subprocess
from collections.abc import Mapping, Sequence
from typing import Self

from runtime.devices.clock import SystemClock

END_S = 5.0
MAX_LINE_BYTES = 65_536


class ChildProcess:
    """A child process with pipes for input and output; on leaving its context, the process is ended.

    The child runs in a new session, so that Ctrl-C on the terminal reaches only the parent: the parent must
    bring the cell into the safe state while the child still runs.

    Raises:
        OSError: the program cannot be started.
        ValueError, IndexError: the command is invalid.
    """

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None
    ) -> None:
        self._read = b""
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env=environment,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        os.set_blocking(self._input.fileno(), False)
        self._unsent = b""

    def close(self) -> None:
        """Ends the child: closes its input, then sends signals. Idempotent."""
        process = self._process
        with contextlib.suppress(OSError):
            self._input.close()
        for insist in (process.terminate, process.kill):
            try:
                process.wait(END_S)
                break
            except subprocess.TimeoutExpired:
                insist()
        process.wait()
        self._output.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _tell(self, line: bytes, until: float) -> None:
        """Sends a line to the child; `line` is without line end.

        Raises:
            TimeoutError: the child has not taken the whole line by the time `until`; the next call first
                sends the rest.
        """
        pipe, self._unsent = self._input.fileno(), self._unsent + line + b"\n"
        while self._unsent:
            if not select.select([], [pipe], [], max(until - SystemClock().now(), 0.0))[1]:
                raise TimeoutError
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[os.write(pipe, self._unsent) :]

    def _line(self, until: float) -> bytes:
        """Waits for the child's next line, and returns it without the line end.

        Raises:
            TimeoutError: no line came by the time `until`.
            EOFError: the child has ended, or sends an endless line.
        """
        pipe = self._output.fileno()
        while b"\n" not in self._read:
            if not select.select([pipe], [], [], max(until - SystemClock().now(), 0.0))[0]:
                raise TimeoutError
            piece = os.read(pipe, 4096)
            if not piece or len(self._read) > MAX_LINE_BYTES:
                raise EOFError
            self._read += piece
        line, _, self._read = self._read.partition(b"\n")
        return line
