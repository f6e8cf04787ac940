"""Runs the simulated cell as a child process, which prints its addresses and ends with this process."""

import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

from runtime.devices.child import ChildProcess
from runtime.devices.clock import SystemClock
from runtime.shell.errors import UnreachableError

START_S = 60.0  # the planner's world compiles its kernels on the first start
MODULE = "drivers.sim.cli"


class Endpoints(NamedTuple):
    """Addresses of the cell's devices, in the form that `drivers.connect` takes."""

    gripper: str
    arm: str
    scene: str
    world: str
    camera: str = ""  # the address of a picture, if the cell was started with a camera


class CellProcess(ChildProcess):
    """A running simulated cell (`grasp-cell`); `endpoints` has the addresses of its devices.

    The arguments are options of `grasp-cell`. The child reads a pipe from this process, and ends when the
    pipe is closed: it ends even if this process is killed.

    Raises:
        UnreachableError: the command cannot be started, has ended, or prints no endpoints.
    """

    def __init__(
        self, table: Path, *, world: str, seed: int, time_scale: float, camera: bool = False
    ) -> None:
        command = [sys.executable, "-P", "-m", MODULE, "--json", "--until-stdin-closes"]
        command += ["--tree", str(table), "--world", world, "--seed", str(seed)]
        command += ["--time-scale", repr(time_scale), *(["--camera"] if camera else [])]
        try:
            super().__init__(command, _environment())
        except OSError as error:
            message = f"grasp-cell cannot be started: {error.strerror}: {command[0]}"
            raise UnreachableError(f"{message}; try it by itself") from error
        try:
            self.endpoints = self._endpoints()
        except BaseException:  # Ctrl-C, too, must not leave the process behind
            self.close()
            raise

    def _endpoints(self) -> Endpoints:
        try:
            line = self._line(SystemClock().now() + START_S)
        except TimeoutError:
            raise UnreachableError(
                f"grasp-cell printed no endpoints within {START_S:g} s; try it by itself"
            ) from None
        except EOFError:
            code = self._process.wait()
            raise UnreachableError(
                f"grasp-cell ended with exit code {code} before it served; see its line above"
            ) from None
        try:
            record = json.loads(line)
            named = {name: str(record[name]) for name in Endpoints._fields if name in record}
            return Endpoints(**named)
        except (ValueError, TypeError) as error:
            raise UnreachableError(
                f"grasp-cell printed {line[:200]!r} instead of its endpoints"
            ) from error


def _environment() -> dict[str, str]:
    """The environment for the child, with a PYTHONPATH by which it imports the same packages."""
    home = str(Path(__file__).resolve().parents[2])
    others = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([home, others] if others else [home])}
