"""`grasp-cell` and the commands of the cell as processes, for tests with real bytes, files and signals."""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

from programs import CELL, REHEARSAL, RUNTIME, WAIT_S, Closing, started

CALIBRATE = (sys.executable, "-c", "import sys, runtime.cli as cli; sys.exit(cli.calibrate())")


class RunningCell(Closing):
    """`grasp-cell` as a process, faster than real time; its widths are drawn from the table's statistics.

    The seed is 0, with which the first part takes both squeezes of the small table.

    Attributes:
        endpoints: the addresses of the cell's devices, by name.
    """

    def __init__(self, tree: Path, *more: str, time_scale: float = 12) -> None:
        words = [*CELL, "--tree", tree, "--json", "--until-stdin-closes", *REHEARSAL]
        words += ["--time-scale", time_scale, "--seed", "0", *more]
        self.process = started(words, stdin=subprocess.PIPE, stderr=None)
        assert self.process.stdout is not None
        self.endpoints = json.loads(self.process.stdout.readline())

    def close(self) -> None:
        with self.process as process:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(WAIT_S)


class Notices:
    """Receives what a run reports to the service manager: `READY=1` and its phases."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "notify"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self.path))

    @property
    def environment(self) -> dict[str, str]:
        """The environment of a process that reports here."""
        return {**os.environ, "NOTIFY_SOCKET": str(self.path)}

    def wait(self, text: str, process: "subprocess.Popen[str]") -> bool:
        """Waits until the process reports a text; returns False if the process ends before."""
        until = time.monotonic() + WAIT_S
        self._socket.settimeout(0.05)
        while time.monotonic() < until:
            try:
                if text in self._socket.recv(4096).decode():
                    return True
            except TimeoutError:
                if process.poll() is not None:
                    return False
        raise TimeoutError(f"{text} was not told within {WAIT_S} s")

    def close(self) -> None:
        """Closes and removes the socket."""
        self._socket.close()
        self.path.unlink()


def runtime_command(tree: Path, cell: RunningCell, journal: Path, *more: str) -> list[str]:
    """The command of `grasp-runtime` on a running cell."""
    words = [*RUNTIME, "--tree", str(tree), "--activate", "--tips", "straight"]
    words += ["--port", cell.endpoints["gripper"], "--arm", cell.endpoints["arm"]]
    return [*words, "--journal", str(journal), *more]


def calibrate_command(cell: RunningCell, output: Path, *more: str) -> list[str]:
    """The command of `grasp-calibrate width` on a running cell."""
    words = [*CALIBRATE, "width", "--port", cell.endpoints["gripper"]]
    return [*words, "--gripper", "S/N-1", "-o", str(output), *more]
