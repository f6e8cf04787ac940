"""The simulated cell as a process of its own: started, its endpoints read, ended with this process."""

import contextlib
import json
import os
import select
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self

from runtime.devices.clock import SystemClock
from runtime.devices.ports import Clock
from runtime.errors import CellStartError

START_S = 60.0  # the planner's world compiles its kernels on the first start
END_S = 5.0
MODULE = "drivers.sim.cli"
DEVICES = ("gripper", "arm", "scene", "world")


class Endpoints(NamedTuple):
    """Where the cell's devices are to be reached, as a port is named to `drivers.connect`.

    `camera` is the address of a picture, empty where the cell was started without a camera.
    """

    gripper: str
    arm: str
    scene: str
    world: str
    camera: str = ""


class CellProcess:
    """A running `grasp-cell`; leaving the context ends it.

    It reads our end of a pipe, so that it ends even if this process is killed; and it has a session of its
    own, so that a Ctrl-C on the terminal reaches only us, who still need its devices for the safe state.

    Attributes:
        endpoints: where its devices are.
    """

    def __init__(
        self, table: Path, *, world: str, seed: int, time_scale: float, camera: bool = False
    ) -> None:
        """Start it and wait until it serves.

        Args:
            table: the table's file, for part and gripper.
            world: the physics, `module:factory`.
            seed: of the world, the parts and the encoder's noise.
            time_scale: how many of its seconds pass in one of ours.
            camera: whether it has a camera under its table.

        Raises:
            CellStartError: it cannot be started, ended or stayed silent; with what it said.
        """
        command = [sys.executable, "-P", "-m", MODULE, "--json", "--until-stdin-closes"]
        command += ["--tree", str(table), "--world", world, "--seed", str(seed)]
        command += ["--time-scale", repr(time_scale), *(["--camera"] if camera else [])]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env=_environment(),
            )
        except OSError as error:
            told = f"grasp-cell cannot be started: {error.strerror}: {command[0]}"
            raise CellStartError(f"{told}; try it by itself") from error
        try:
            self.endpoints = _endpoints(_first_line(self._process, START_S, SystemClock()))
        except BaseException:  # Ctrl-C, too, must not leave the process behind
            self.close()
            raise

    def close(self) -> None:
        """End it: ask by closing its input, then by signals. Closing twice is harmless."""
        process = self._process
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        for insist in (process.terminate, process.kill):
            try:
                process.wait(END_S)
                break
            except subprocess.TimeoutExpired:
                insist()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _environment() -> dict[str, str]:
    """Our own, in which the packages are the ones we run from, whatever the working directory holds."""
    home = str(Path(__file__).resolve().parents[2])
    others = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([home, others] if others else [home])}


def _first_line(process: subprocess.Popen[bytes], seconds: float, clock: Clock) -> bytes:
    assert process.stdout is not None
    deadline = clock.now() + seconds
    line = b""
    while not line.endswith(b"\n"):
        chunk = _read_some(process.stdout, deadline - clock.now())
        if chunk is None:
            raise CellStartError(f"grasp-cell told no endpoints within {seconds:g} s; try it by itself")
        if not chunk:
            code = process.wait()
            raise CellStartError(
                f"grasp-cell ended with exit code {code} before it served; see its line above"
            )
        line += chunk
    return line.splitlines()[0]


def _read_some(pipe: IO[bytes], seconds: float) -> bytes | None:
    """What the pipe has by then: None for nothing in time, empty at its end."""
    readable, _, _ = select.select([pipe], [], [], max(seconds, 0.0))
    return os.read(pipe.fileno(), 65536) if readable else None


def _endpoints(line: bytes) -> Endpoints:
    try:
        told = json.loads(line)
        gripper, arm, scene, world = (str(told[name]) for name in DEVICES)
        return Endpoints(gripper, arm, scene, world, str(told.get("camera", "")))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise CellStartError(f"grasp-cell told {line[:200]!r} instead of its endpoints") from error
