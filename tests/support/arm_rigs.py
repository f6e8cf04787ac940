"""Arms of every make, simulated. A new make is one more class here, and one more name in `RIGS`."""

import contextlib
import math
import threading

import other_make

from drivers import connect
from drivers.abb.codec import Pose, hand_angle
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.devices.arm_server import ArmServer
from drivers.sim.wire.serving import SimulatedTime

SCALE = 40.0
BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


def opened(url, read_only, frames):
    """An arm whose frames are told in its address."""
    told = (f"{name}={','.join(map(str, (*pose[:3], *pose[3])))}" for name, pose in frames.items())
    query = f"?{'&'.join(told)}" if frames else ""
    return contextlib.closing(connect.arm(url + query, time_scale=SCALE, read_only=read_only))


class Abb:
    """The open_abb driver and its simulated server."""

    far_mm = 900.0

    def __init__(self):
        self.model = ArmModel(BASE)
        time = SimulatedTime(SCALE, threading.Event())
        self.now = time.now
        self.server = ArmServer(self.model, threading.RLock(), time)
        self.server.start()

    @property
    def url(self):
        return self.server.url

    @property
    def moves(self):
        return self.model.moves

    def truth(self):
        x, y, z, rotation = self.model.pose_at(self.now())
        return (x, y, z, hand_angle(rotation))

    def silence(self):
        self.model.execute = lambda text, now: Answer(None, math.inf)

    def open(self, *, read_only=False, **frames):
        return opened(self.url, read_only, frames)

    def close(self):
        self.server.close()


class Other:
    """An arm of another make."""

    far_mm = 900.0

    def __init__(self):
        self.device = other_make.ArmDevice(SCALE)
        self.server = other_make.Server(self.device.answer)
        self.url = f"other://127.0.0.1:{self.server.port}"

    @property
    def moves(self):
        return self.device.moves

    def truth(self):
        return self.device.place

    def silence(self):
        self.device.mute = True

    def open(self, *, read_only=False, **frames):
        return opened(self.url, read_only, frames)

    def close(self):
        self.server.close()


RIGS = {"abb": Abb, "other": Other}
