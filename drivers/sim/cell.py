"""A simulated cell in real time: gripper and arm behind their real protocols, with a part."""

import random
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

from drivers.abb.codec import Pose
from drivers.sim.camera.server import CameraServer
from drivers.sim.devices.arm_server import ArmLogger, ArmServer
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.devices.ur_controller import UrModel
from drivers.sim.devices.ur_ports import served
from drivers.sim.faults import Listed
from drivers.sim.grippers import Bench, Mount, simulator
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.scene_protocol import SceneServer
from drivers.sim.physics.tabletop import Look
from drivers.sim.wire.line import CleanLine
from drivers.sim.wire.serving import Server, SimulatedTime
from drivers.sim.workcell import ARM_BASE, Workcell
from runtime.table import profile_of

if TYPE_CHECKING:
    from drivers.sim.camera.rig import Rig  # needs the audit extra


REACH_MM = 580  # of the simulated arm, behind every controller


class Serving:
    """Servers that share a lock and a time; they serve while the context lasts, or until `stopped` is set.

    Attributes:
        endpoints: their addresses.
    """

    endpoints: dict[str, str]
    _servers: list[Server]

    def __init__(self, time_scale: float) -> None:
        self.stopped = threading.Event()
        self._lock = threading.RLock()
        self._time = SimulatedTime(time_scale, self.stopped)

    def __enter__(self) -> Self:
        for server in self._servers:
            server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stopped.set()
        for server in self._servers:
            server.close()


class LoneGripper(Serving):
    """A simulated gripper of some model, with nothing between its fingers.

    Args:
        model: one of `drivers.sim.grippers.SIMULATORS`.
        seed: of its lags.
        time_scale: simulated seconds per wall second.
        surroundings: what the fingers may meet; None: nothing.
    """

    def __init__(
        self,
        model: str,
        seed: int,
        time_scale: float = 1.0,
        surroundings: Surroundings | None = None,
    ) -> None:
        super().__init__(time_scale)
        lags = random.Random(f"{seed}/gripper")
        mount = Mount(profile_of(model), lags, surroundings or Surroundings())
        self.device = simulator(model).device(mount)
        bench = Bench(self._lock, self._time, lambda **_: CleanLine())
        ports = simulator(model).ports(self.device, bench)
        self._servers = ports.servers
        self.endpoints = {"gripper": ports.path, "port": ports.port, **ports.others}


class Cell(Serving):
    """Gripper on the ports of its make, arm and scene on TCP ports, joined by a world.

    Gripper and arm are one device each: a host uses one of their ports only. Arguments as for `Workcell`;
    `time_scale` is simulated seconds per wall second, `rig` the camera, if any.
    """

    def __init__(
        self,
        setting: Setting,
        seed: int,
        time_scale: float = 1.0,
        faults: Listed | None = None,
        rig: "Rig | None" = None,
    ) -> None:
        super().__init__(time_scale)
        self.works = Workcell(setting, seed, self._time.now, faults)
        bench = Bench(self._lock, self._time, self.works.line)
        gripper = self.works.simulator.ports(self.works.gripper, bench)
        arm = ArmServer(self.works.arm, self._lock, self._time, self.works.arm_stands)
        ur = UrModel(self.works.arm, ARM_BASE, self.works.arm_stands)
        ur_script, ur_rtde = served(ur, self._lock, self._time)
        logger = ArmLogger(self._look_at_arm, self._time)
        scene = SceneServer(self._answer, self.stopped)
        self._servers: list[Server] = [*gripper.servers, arm, ur_script, ur_rtde, logger, scene]
        # Addresses of its devices, for `drivers.connect`.
        base = ",".join(f"{value:g}" for value in ARM_BASE[:3])
        self.endpoints = {
            "gripper": gripper.port,
            "arm": f"{arm.url}?base={base}",
            "scene": scene.url,
            "world": setting.world,
            "arm_logger": logger.url,
            **gripper.others,
            "arm_ur": f"ur://127.0.0.1:{ur_rtde.port}?base={base}&reach={REACH_MM}",
        }
        if rig is not None:
            camera = CameraServer(rig.watcher(self._look, seed))
            self._servers.append(camera)
            self.endpoints["camera"] = camera.url

    def _look_at_arm(self) -> tuple[Pose, tuple[float, ...]]:
        with self._lock:
            now_s = self._time.now()
            return self.works.arm.pose_at(now_s), self.works.arm.joints_at(now_s)

    def _look(self) -> Look:
        with self._lock:
            return self.works.look()

    def _answer(self, what: str) -> Mapping[str, object]:
        with self._lock:
            said = self.works.answer(what)
        if said is None and what == "quit":
            return {"quit": True}
        return said or {"error": f"cannot {what}; next_part, truth and quit are known"}
