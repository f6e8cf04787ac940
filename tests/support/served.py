"""`grasp-runtime` as a server process: as a decision server, or with a PLC as the master."""

import json
from pathlib import Path

from programs import RUNTIME, WAIT_S, Closing, started


class ServedRun(Closing):
    """A process of `grasp-runtime`, which listens at the TCP port `port`.

    Args:
        folder: folder for the run's journal and output.
        ready: text by which a line on standard error says that the run is ready; the line ends with the port.
        words: arguments of the command besides `--json` and `--journal`.
    """

    def __init__(self, folder: Path, ready: str, *words: str) -> None:
        self.journal, self._output = folder / "journal.jsonl", folder / "output.jsonl"
        words = (*RUNTIME, "--json", "--journal", str(self.journal), *words)
        with self._output.open("w") as output:  # the run would block on a pipe that is not read
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
        """Waits until the run ends; returns its exit code, its parts and the rest of its standard error."""
        _, err = self.process.communicate(timeout=WAIT_S)
        parts = [json.loads(line) for line in self._output.read_text().splitlines()]
        return self.process.returncode, parts, err

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
