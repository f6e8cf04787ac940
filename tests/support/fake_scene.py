"""What a simulated cell starts from when neither table nor job matters: a 21 mm part, squeezed anywhere."""

import math
from dataclasses import replace

from drivers.sim.physics.scene import Geometry, Setting
from runtime.table import PROFILES

GEOMETRY = Geometry(
    gripper=replace(PROFILES["robotiq-2f-85"], noise_um=0),
    squeeze_height_mm=10.0,
    retreat_height_mm=60.0,
    radius_mm=5.0,
    halfwidth_rad=math.pi,
)


class FakeWorld:
    """A part that lines up with the fingers and is centred between them."""

    width_mm = 21.0

    def squeeze(self, pose_hand):
        return (pose_hand[0], 0.0, 0.0), self.width_mm, "grasped"

    def collides(self, pose_hand, opening_mm):
        return abs(pose_hand[1]) > opening_mm / 2.0 - self.width_mm


def setting(world=None):
    """A setting with that world."""
    return Setting(None, GEOMETRY, "fake", lambda job, seed: world or FakeWorld())


# Worlds as `--world` names them.


def make(job, seed):
    return FakeWorld()


def broken(job, seed):
    raise RuntimeError("this world\nis broken")


class Stumbling:
    """Works once, to warm up; the next one fails."""

    instances = 0

    def __init__(self):
        Stumbling.instances += 1
        self.fails = Stumbling.instances > 1

    def squeeze(self, pose_hand):
        if self.fails:
            raise RuntimeError("no such squeeze")
        return pose_hand, 0.0, "untouched"


def stumbling(job, seed):
    return Stumbling()


not_callable = 3
