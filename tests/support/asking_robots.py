"""Robots that ask the decision server `grasp-runtime --serve`, and a process that runs this server."""

import socket
from math import radians
from pathlib import Path
from types import ModuleType

from counting import count_of
from programs import ROOT, WAIT_S, Closing, module_at
from served import ServedRun
from structured_text import FunctionBlock

from drivers.ports import ObjectState
from drivers.sim.physics.scene import Setting
from drivers.sim.virtual.cell import VirtualCell
from runtime.execution.events import Console
from runtime.execution.executor import Cell, RunOptions
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling
from runtime.execution.session import run_journalled
from runtime.journal.chain import Journal
from runtime.table import PPM, Branch, Node, Squeeze, Table

CLIENTS = ROOT / "tools" / "docs" / "clients"


def client() -> ModuleType:
    """Imports and returns tools/docs/clients/robot.py, a client that uses no code of this project."""
    return module_at(CLIENTS / "robot.py")


class SimulatedRobot:
    """A robot for the clients in tools/docs/clients: arm and gripper of a simulated cell in virtual time."""

    def __init__(self, setting: Setting, seed: int, table: Table) -> None:
        self.cell = VirtualCell(setting, seed)
        gripper, arm = self.cell.gripper(), self.cell.arm()
        gripper.activate()
        self._hand = Hand(gripper, arm, self.cell.clock, table, Handling())
        self._plan: Squeeze | None = None

    def place(self, x: float, y: float, angle: float, opening: float) -> None:
        um = (round(1000 * value) for value in (x, y))
        self._plan = Squeeze(*um, round(1e6 * radians(angle)), round(1000 * opening), 0, 0, 0)
        self._at = (self._plan.x_um / 1000, self._plan.y_um / 1000, self._plan.angle_urad / 1e6)

    def squeeze(self, speed: float, force: float) -> tuple[int, bool]:
        assert self._plan is not None
        um_s, mn = round(1000 * speed), round(1000 * force)
        self._plan = self._plan._replace(speed_um_s=um_s, force_mn=mn)
        self._hand.retreat()
        self._hand.jaws.open(self._plan)
        self._hand.travel(*self._at)
        self._hand.descend(*self._at)
        any_width = Branch(0, 0, self._plan.opening_um, PPM, ~0)
        reading = self._hand.close(Node(self._plan, (any_width,)))
        return count_of(reading.width_um), reading.object is ObjectState.CLOSING

    def drag(self, x: float, y: float) -> None:
        self._hand.slide(x, y)

    def release(self) -> None:
        assert self._plan is not None
        self._hand.release(self._plan)
        self._hand.retreat()


class Controller:
    """The client tools/docs/clients/robot.st, called cycle by cycle as a PLC calls it.

    `line` is the connection to the decision server.
    """

    ERROR = 4

    def __init__(self, line: "Line") -> None:
        self._line = line
        self._block = FunctionBlock((CLIENTS / "robot.st").read_text())

    def cycle(self, **changes: object) -> dict[str, object]:
        """Calls the function block once and returns its outputs; inputs outside `changes` are idle."""
        quiet = {"start": False, "answered": False, "answer": "", "placed": False}
        return self._block(**{**quiet, "counts": 0, "held": False, "released": False, **changes})

    def locate(self, robot: SimulatedRobot) -> tuple[float, ...] | None:
        """Locates one part; returns x mm, y mm, angle deg and success rate, or None if it was not located.

        Raises:
            RuntimeError: the block waits in a state that asks nothing of the robot.
        """
        result = self.cycle(start=True)
        while result["state"] != 0:
            if result["send"]:
                result = self.cycle(answered=True, answer=self._line.ask(str(result["line"])))
            elif result["state"] == 2:
                robot.place(*(result[name] for name in ("x", "y", "angle", "opening")))
                count, held = robot.squeeze(result["speed"], result["force"])
                result = self.cycle(placed=True, counts=count, held=held)
            elif result["state"] == 3:
                if result["drag"]:
                    robot.drag(result["drag_x"], result["drag_y"])
                robot.release()
                result = self.cycle(released=True)
            else:
                raise RuntimeError(f"state {result['state']}")
        if not result["located"]:
            return None
        return tuple(result[name] for name in ("x", "y", "angle", "success"))


class Results(Console):
    """A console that collects outcome, leaf and readings of each part."""

    def __init__(self) -> None:
        self.parts: list[dict[str, object]] = []

    def part(self, result: object, seen: object) -> None:
        readings_mm = [step.reading_um / 1000 for step in result.steps]
        end = {"outcome": result.outcome.value, "leaf": result.leaf}
        self.parts.append({**end, "readings_mm": readings_mm})


def driven(
    setting: Setting, seed: int, table: Table, count: int, journal: Journal
) -> list[dict[str, object]]:
    """Runs `count` parts with the executor in a simulated cell.

    Returns outcome, leaf and readings of each part, as `Results` collects them.
    """
    cell, result = VirtualCell(setting, seed), Results()
    devices = Cell(cell.gripper(), cell.arm(), cell.clock, journal, scene=cell.scene)
    run_journalled(table, devices, result, RunOptions(activate=True, count=count))
    return result.parts


class Served(ServedRun):
    """A process of `grasp-runtime --serve`, which listens at the TCP port `port`."""

    def __init__(self, tree: Path, *more: str) -> None:
        words = ["--tree", str(tree), "--serve", "tcp://127.0.0.1:0", *more]
        super().__init__(tree.parent, "a robot may ask at", *words)


class Line(Closing):
    """A TCP connection to the decision server, for lines and for arbitrary bytes."""

    def __init__(self, served: Served) -> None:
        self.socket = socket.create_connection(("127.0.0.1", served.port), timeout=WAIT_S)
        self._file = self.socket.makefile("rb")

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def read(self) -> str:
        """Returns the server's next line, or "" if the connection has ended."""
        return self._file.readline().decode("ascii").rstrip("\n")

    def ask(self, line: str) -> str:
        self.send(line.encode() + b"\n")
        return self.read()

    def close(self) -> None:
        self._file.close()
        self.socket.close()
