"""`grasp-runtime` as a process that serves others, for tests."""

import json
from pathlib import Path

from programs import RUNTIME, WAIT_S, Closing, started


class ServedRun(Closing):
    """A run that serves; `port` is where it answers, and its journal is in the folder.

    Args:
        folder: for its journal and its output.
        ready: words of the line that ends with the port.
        words: of the command line, beside `--json` and `--journal`.
    """

    def __init__(self, folder: Path, ready: str, *words: str) -> None:
        self.journal, self._output = folder / "journal.jsonl", folder / "output.jsonl"
        words = (*RUNTIME, "--json", "--journal", str(self.journal), *words)
        with self._output.open("w") as output:  # a pipe that is not read would hold it up
            self.process = started(words, stdout=output)
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

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
