"""A whole simulated cell in real time: gripper and arm behind their real protocols, a part between them."""

import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

from drivers.abb.codec import Pose
from drivers.robotiq.frames import TCP
from drivers.sim.camera.server import CameraServer
from drivers.sim.devices.arm_server import ArmLogger, ArmServer
from drivers.sim.devices.gripper_tcp import MbapSlave, TcpPort, stop_jaws
from drivers.sim.devices.gripper_urcap import Urcap, UrcapPort
from drivers.sim.devices.ur_controller import UrModel
from drivers.sim.devices.ur_ports import served
from drivers.sim.faults import Listed
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.scene_protocol import SceneServer
from drivers.sim.physics.tabletop import Look
from drivers.sim.wire.modbus import GripperRegisters
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import Server, SimulatedTime
from drivers.sim.workcell import ARM_BASE, Workcell

if TYPE_CHECKING:
    from drivers.sim.camera.rig import Rig  # needs the audit extra


REACH_MM = 580  # of the simulated arm, behind every controller


class Cell:
    """Gripper on a pty and three TCP ports, arm and scene on TCP ports, joined by a world.

    Gripper and arm are one device each: a host picks one of their ports and leaves the others alone. Made as
    `Workcell` is; `time_scale` is simulated seconds per wall second, `rig` the camera, if there is one.
    """

    def __init__(
        self,
        setting: Setting,
        seed: int,
        time_scale: float = 1.0,
        faults: Listed | None = None,
        rig: "Rig | None" = None,
    ) -> None:
        self.stopped = threading.Event()
        self._lock = threading.RLock()
        self._time = SimulatedTime(time_scale, self.stopped)
        self.works = Workcell(setting, seed, self._time.now, faults)
        device, now = self.works.gripper, self._time.now
        registers = GripperRegisters(device, now)
        pty = PtyPort(RtuSlave(registers, self.works.line()), self._lock, self._time)
        rtu_tcp = TcpPort(RtuSlave(registers, self.works.line()), self._lock, self._time)
        slave = MbapSlave(GripperRegisters(device, now, TCP), self.works.line(checked=False))
        tcp = TcpPort(slave, self._lock, self._time, lambda: stop_jaws(device, now))
        urcap = UrcapPort(Urcap(device, now), self._lock)
        arm = ArmServer(self.works.arm, self._lock, self._time, self.works.arm_stands)
        ur = UrModel(self.works.arm, ARM_BASE, self.works.arm_stands)
        ur_script, ur_rtde = served(ur, self._lock, self._time)
        logger = ArmLogger(self._look_at_arm, self._time)
        scene = SceneServer(self._answer, self.stopped)
        self._servers: list[Server] = [
            pty,
            rtu_tcp,
            tcp,
            urcap,
            arm,
            ur_script,
            ur_rtde,
            logger,
            scene,
        ]
        # Where its devices are, as `drivers.connect` takes them.
        base = ",".join(f"{value:g}" for value in ARM_BASE[:3])
        self.endpoints = {
            "gripper": pty.path,
            "arm": f"{arm.url}?base={base}",
            "scene": scene.url,
            "world": setting.world,
            "arm_logger": logger.url,
            "gripper_tcp": tcp.url,
            "gripper_rtu_tcp": f"rtu+{rtu_tcp.url}",
            "gripper_urcap": urcap.url,
            "arm_ur": f"ur://127.0.0.1:{ur_rtde.port}?base={base}&reach={REACH_MM}",
        }
        if rig is not None:
            camera = CameraServer(rig.watcher(self._look, seed))
            self._servers.append(camera)
            self.endpoints["camera"] = camera.url

    def __enter__(self) -> "Cell":
        for server in self._servers:
            server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stopped.set()
        for server in self._servers:
            server.close()

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
