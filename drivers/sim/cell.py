"""A simulated cell in real time: gripper and arm behind their real protocols, with a part."""

import random
from collections.abc import Mapping
from typing import TYPE_CHECKING

from drivers.sim.camera.server import CameraServer
from drivers.sim.devices.arm_server import ArmServer, open_logger
from drivers.sim.devices.ur_controller import UrModel
from drivers.sim.devices.ur_ports import served
from drivers.sim.faults import Listed
from drivers.sim.grippers import simulator
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.scene_protocol import open_port
from drivers.sim.wire.line import Line
from drivers.sim.wire.serving import HOST, Site
from drivers.sim.workcell import ARM_BASE, Workcell
from runtime.table import profile_of

if TYPE_CHECKING:
    from drivers.sim.camera.rig import Rig  # needs the audit extra


REACH_MM = 580  # reach of the simulated arm, which is the same behind every controller


class LoneGripper(Site):
    """A simulated gripper of some model, with nothing between its fingers.

    Args:
        model: one of `drivers.sim.grippers.SIMULATORS`.
        seed: seed of the gripper's lags.
        time_scale: simulated seconds per wall second.
    """

    def __init__(self, model: str, seed: int, time_scale: float = 1.0) -> None:
        super().__init__(time_scale)
        make = simulator(model)
        device = make.model(random.Random(f"{seed}/gripper"), profile=profile_of(model))
        path, others = make.ports(device, self, lambda **_: Line())
        self.endpoints = {"gripper": path, "port": make.scheme + path, **others}


class Cell(Site):
    """A simulated cell: the gripper on the ports of its make, arm and scene on TCP ports.

    All ports of the gripper lead to one gripper, and all ports of the arm to one arm: clients must use only
    one port of the gripper, and one of the arm.

    Args:
        setting: part and world.
        seed: seed of all random numbers.
        time_scale: simulated seconds per wall second.
        faults: schedule of faults; None: no faults.
        rig: the camera; None: there is none.
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
        self.works = Workcell(setting, seed, self.now, faults)
        make = self.works.simulator
        path, others = make.ports(self.works.gripper, self, self.works.line)
        arm = ArmServer(self.works.arm, self, self.works.arm_stands)
        _, rtde = served(UrModel(self.works.arm, ARM_BASE, self.works.arm_stands), self)
        scene = open_port(self._answer, self)
        # Addresses of the cell's devices, for `drivers.connect`.
        base = ",".join(f"{value:g}" for value in ARM_BASE[:3])
        self.endpoints = {
            "gripper": make.scheme + path,
            "arm": f"{arm.url}?base={base}",
            "scene": f"tcp://{HOST}:{scene}",
            "world": setting.world,
            "arm_logger": open_logger(self.works.arm, self),
            **others,
            "arm_ur": f"ur://{HOST}:{rtde.port}?base={base}&reach={REACH_MM}",
        }
        self._camera: CameraServer | None = None
        if rig is not None:
            self._camera = CameraServer(rig.watcher(lambda: self.call(self.works.look), seed))
            self.endpoints["camera"] = self._camera.url

    def close(self) -> None:
        """Stops serving, and disconnects all clients."""
        if self._camera is not None:
            self._camera.close()
        super().close()

    def _answer(self, what: str) -> Mapping[str, object]:
        said = self.works.answer(what)
        if said is None and what == "quit":
            return {"quit": True}
        return said or {"error": f"cannot {what}; next_part, truth and quit are known"}
