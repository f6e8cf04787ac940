"""Reads drawings in a separate process: a hostile drawing ends that process, not the page."""

import json
import select
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.shell.errors import InputError

PATIENCE_S = 120.0  # the process itself gives a drawing up after 30 s, unless a library prevents it
READER = [sys.executable, "-P", "-m", "planner.cli.preview"]


class Reader:
    """A process of `planner.cli.preview`, started on demand; it ends with the studio."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._child: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def ask(self, arguments: Sequence[str]) -> dict[str, Any]:
        """The preview for arguments of `squeezetree try`; see `planner.cli.preview.preview`.

        Raises:
            InputError: the process died or took too long.
        """
        with self._lock:
            child = self._child if self._child and self._child.poll() is None else self._begun()
            assert child.stdin is not None
            assert child.stdout is not None
            line = b""
            try:
                child.stdin.write(json.dumps(arguments).encode() + b"\n")
                child.stdin.flush()
                if select.select([child.stdout], [], [], PATIENCE_S)[0]:
                    line = child.stdout.readline()
            except OSError:  # the process has ended, which is handled below
                line = b""
            if not line.endswith(b"\n"):
                self._end()
                problem = "reading it takes too much memory or time"
                remedy = "export the part's outline alone"
                raise InputError(f"{problem}; {remedy}", where=arguments[0])
        return dict(json.loads(line))

    def close(self) -> None:
        """Ends the process."""
        with self._lock:
            self._end()

    def _begun(self) -> subprocess.Popen[bytes]:
        self._end()
        self._child = subprocess.Popen(
            READER,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=self._folder,
            start_new_session=True,
        )
        return self._child

    def _end(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None
