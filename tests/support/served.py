"""`grasp-runtime` as a process that serves others, for tests."""

import json
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from waiting import WAIT_S

ROOT = Path(__file__).parents[2]


class ServedRun:
    """A run that serves; `port` is where it answers, and its journal is in the folder.

    Args:
        folder: for its journal and its output.
        ready: words of the line that ends with the port.
        words: of the command line, beside `--json` and `--journal`.
    """

    def __init__(self, folder: Path, ready: str, *words: str) -> None:
        self.journal, self._output = folder / "journal.jsonl", folder / "output.jsonl"
        command = [sys.executable, "-m", "runtime.cli", "--json", "--journal", str(self.journal)]
        with self._output.open("w") as output:  # a pipe that is not read would hold it up
            self.process = subprocess.Popen(
                [*command, *words], cwd=ROOT, text=True, stdout=output, stderr=subprocess.PIPE
            )
        assert self.process.stderr is not None
        line = ""
        while ready not in line:
            line = self.process.stderr.readline()
            if not line:
                self.process.communicate()
                raise AssertionError(f"ended with {self.process.returncode}")
        self.port = int(line.rpartition(":")[2])

    def ended(self) -> tuple[int, list[dict[str, object]], str]:
        """Its exit code, its parts and its last words, once it has ended by itself or been asked to."""
        _, err = self.process.communicate(timeout=WAIT_S)
        parts = [json.loads(line) for line in self._output.read_text().splitlines()]
        return self.process.returncode, parts, err

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
