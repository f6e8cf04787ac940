"""Simulated arms of every make. A new make needs a class here, and a name in `RIGS`."""

import atexit
import contextlib
import math
import os
import shutil
import tempfile
import threading
from functools import cache

import trustme
from omnicore_controller import OmniCore, RwsServer

from drivers import connect
from drivers.abb import rws
from drivers.abb.codec import Pose, hand_angle
from drivers.abb.kinematics import compose
from drivers.sim.devices.arm import Answer, ArmModel
from drivers.sim.devices.arm_server import ArmServer
from drivers.sim.devices.ur_controller import UrModel
from drivers.sim.devices.ur_ports import served
from drivers.sim.wire.serving import Site

SCALE = 40.0
BASE = Pose(-300.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0))


class ArmRig:
    """A simulated arm with its controller; `open` connects the driver.

    A subclass sets `url`, the address for the driver, and `model`, the simulated controller.
    """

    far_mm = 900.0
    base = BASE  # pose of the arm's base that the address states
    limits = "&reach=580"

    def __init__(self):
        self.arm = ArmModel(BASE)
        self.site = Site(SCALE)
        self.now = self.site.now

    @property
    def moves(self):
        return self.arm.moves

    def truth(self):
        flange = compose(BASE, self.arm.flange_at(self.now()))
        return (*flange[:3], hand_angle(flange.rotation))

    def open(self, *, read_only=False, **frames):
        stated = {"base": self.base, **frames}.items()
        words = [f"{name}={','.join(map(str, (*at[:3], *at[3])))}" for name, at in stated if at]
        url = f"{self.url}?{'&'.join(words)}{self.limits}" if words else self.url
        return contextlib.closing(connect.arm(url, time_scale=SCALE, read_only=read_only))

    def close(self):
        self.site.close()


class Abb(ArmRig):
    """A simulated open_abb server, for the open_abb driver."""

    base, limits = None, ""

    def __init__(self):
        super().__init__()
        self.model = self.arm
        self.url = ArmServer(self.model, self.site).url

    def truth(self):
        x, y, z, rotation = self.model.pose_at(self.now())
        return (x, y, z, hand_angle(rotation))

    def silence(self):
        self.model.execute = lambda text, now: Answer(None, math.inf)


class AbbWithBase(Abb):
    """A simulated open_abb server whose address states the arm's base: the driver then knows the reach."""

    base = BASE


class Ur(ArmRig):
    """A simulated UR controller, for the UR driver."""

    def __init__(self):
        super().__init__()
        self.model = UrModel(self.arm, BASE)
        self.script_port, self.rtde = served(self.model, self.site)
        self.url = f"ur://127.0.0.1:{self.rtde.port}"

    def silence(self):
        self.rtde.mute = True


class OmniCoreRig(ArmRig):
    """A simulated OmniCore controller, for the OmniCore driver."""

    def __init__(self, *, digest=False):
        super().__init__()
        self.model = OmniCore(self.arm)
        pem = os.environ[rws.CERTIFICATE] = certificate()
        self.server = RwsServer(self.model, threading.RLock(), self.now, pem, digest=digest)
        self.url = self.server.url

    def silence(self):
        self.server.mute = True

    def close(self):
        os.environ.pop(rws.CERTIFICATE, None)
        self.server.close()
        super().close()


@cache
def certificate():
    """Returns the path of a PEM file: a certificate, its key, and the test authority that issued it."""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    path = f"{folder}/controller.pem"
    authority = trustme.CA()
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    authority.cert_pem.write_to_path(path, append=True)
    return path


RIGS = {"abb": AbbWithBase, "ur": Ur, "omnicore": OmniCoreRig}
