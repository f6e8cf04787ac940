"""A whole simulated cell: gripper and arm behind their real protocols, a part between them, one clock."""

import random
import threading
import time

from drivers.abb.codec import Pose, ProtocolError, hand_angle
from drivers.sim.arm import ArmModel
from drivers.sim.arm_server import ArmServer
from drivers.sim.eye import SceneServer
from drivers.sim.gripper import GripperModel
from drivers.sim.jaws import Jaws
from drivers.sim.modbus import GripperRegisters
from drivers.sim.rtu import PtyPort, RtuSlave
from drivers.sim.scene import Pose2, Setting
from drivers.sim.tabletop import TableTop

ARM_BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))  # in the world: the table's middle is in reach


class SimulatedTime:
    """Simulated seconds: wall time since the start, times the scale.

    Args:
        scale: simulated seconds per wall second.
        stopped: ends every pause early.
    """

    def __init__(self, scale: float, stopped: threading.Event) -> None:
        self._scale = scale
        self._stopped = stopped
        self._start = time.monotonic()

    def now(self) -> float:
        """Simulated seconds since the cell came up."""
        return (time.monotonic() - self._start) * self._scale

    def sleep(self, seconds: float) -> None:
        """Pause for so many simulated seconds, or until the cell stops."""
        self._stopped.wait(seconds / self._scale)


class Cell:
    """Gripper on a pty, arm and scene on TCP ports, joined by a world.

    Args:
        setting: part and world.
        seed: of every draw.
        time_scale: simulated seconds per wall second.
    """

    def __init__(self, setting: Setting, seed: int, time_scale: float = 1.0) -> None:
        self.stopped = threading.Event()
        self.world = setting.world
        self._lock = threading.RLock()
        self._time = SimulatedTime(time_scale, self.stopped)
        self._table = TableTop(setting, seed)
        geometry = setting.geometry
        self._jaws = Jaws(geometry.opening_mm, geometry.count_open, geometry.count_closed)
        self._gripper = GripperModel(random.Random(f"{seed}/gripper"), self._jaws, self)
        self._arm = ArmModel(ARM_BASE)
        self._low = False
        slave = RtuSlave(GripperRegisters(self._gripper, self._time.now))
        self._port = PtyPort(slave, self._lock, self._time.sleep)
        self._arm_server = ArmServer(
            self._arm, self._lock, self._time.now, self._time.sleep, self.stopped, self._arm_stands
        )
        self._scene_server = SceneServer(self._answer, self.stopped)

    @property
    def endpoints(self) -> dict[str, str]:
        """Where its devices are, as `drivers.connect` takes them."""
        return {
            "gripper": self._port.path,
            "arm": self._arm_server.url,
            "scene": self._scene_server.url,
            "world": self.world,
        }

    def __enter__(self) -> "Cell":
        for server in (self._port, self._arm_server, self._scene_server):
            server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stopped.set()
        for server in (self._port, self._arm_server, self._scene_server):
            server.close()

    # -- what the fingers meet: drivers.sim.gripper.Surroundings ----------------------------------

    def closing(self) -> int | None:
        """The jaws start to close: where they will stop, given where the arm really is."""
        hand = self._hand()
        if hand is None:
            return None
        width_mm = self._table.squeeze(hand)
        return None if width_mm is None else self._jaws.count_at(width_mm)

    def gripped(self) -> None:
        """They stopped at the part."""
        self._table.gripped()

    def _hand(self) -> Pose2 | None:
        """Where the hand is, if it is down at the part and upright."""
        x, y, z, rotation = self._arm.pose_at(self._time.now())
        if z > self._table.geometry.reach_mm:
            return None
        try:
            return (x, y, hand_angle(rotation))
        except ProtocolError:
            return None

    def _arm_stands(self) -> None:
        """An arm instruction is over: a hand that came down may stand on the part."""
        with self._lock:
            hand, was_low = self._hand(), self._low
            self._low = hand is not None
            if hand is not None and not was_low:
                self._table.placed(hand, self._gripper.opening_mm(self._time.now()))

    def _answer(self, what: str) -> dict[str, object]:
        with self._lock:
            self._gripper.advance(self._time.now())
            if what == "next_part":
                return {"part": self._table.next_part()}
            if what == "truth":
                return self._table.truth()
        if what == "quit":
            self.stopped.set()
            return {"quit": True}
        return {"error": f"cannot {what}; next_part, truth and quit are known"}
